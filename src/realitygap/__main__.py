"""`python -m realitygap`: the same as the `realitygap` script."""

from realitygap.cli import main

if __name__ == "__main__":
    main()
