"""`python -m pps_vision`, and the command `pps-vision`."""

import sys


def main() -> None:
    """Run the command line; what is missing to even start (a system library) is said in one line."""
    try:
        from pps_vision.app.cli import main as run  # here, so that an interrupt or a missing library is caught

        run()
    except ImportError as error:
        print(f"pps-vision: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
