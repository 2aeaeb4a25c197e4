"""Controllers that know the equations: regulators, plans of swing-ups and transitions, MPC."""
