"""`python -m headway`, and the `headway` command."""

from headway.cli.app import main

if __name__ == "__main__":
    main()
