"""`python -m pps_vision`: the command line."""

from pps_vision.app.cli import main

if __name__ == "__main__":
    main()
