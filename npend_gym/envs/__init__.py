"""Gymnasium environments around the chain: NPendulumVectorEnv and its view of one, NPendulumEnv."""
