"""Reports: given results, draw and write them; nothing is measured here."""
