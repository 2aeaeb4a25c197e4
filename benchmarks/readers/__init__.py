"""Engines that read our files: what each makes of the accelerations of a chain."""
