"""`python -m leg_dynamics.cli`: the command line."""

from leg_dynamics.cli import main

if __name__ == "__main__":
    main()
