"""Trained networks: how they act, their files, the ones that are shipped, the Hub."""
