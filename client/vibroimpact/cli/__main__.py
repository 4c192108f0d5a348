"""``python -m vibroimpact.cli``."""

from vibroimpact.cli import main

if __name__ == "__main__":
    main()
