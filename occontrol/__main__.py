"""python -m occontrol: the command line."""

from occontrol.cli import main

if __name__ == "__main__":
    main()
