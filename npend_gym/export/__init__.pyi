from npend_gym.export.c import to_c as to_c
