"""The mechanics of the chain: equations of motion, integration, energy."""
