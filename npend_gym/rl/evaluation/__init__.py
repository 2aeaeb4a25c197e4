"""How well a controller does: episodes, robustness, the scores of RealAIGym, statistics."""
