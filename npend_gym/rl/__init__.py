"""Learning: the adapter for Stable-Baselines3, reference controllers, policies, evaluation."""
