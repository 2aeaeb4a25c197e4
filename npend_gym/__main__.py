"""`python -m npend_gym` is `npend`."""

from npend_gym.cli import main

if __name__ == "__main__":
    raise SystemExit(main())
