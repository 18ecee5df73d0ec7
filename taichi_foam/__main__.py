"""`python -m taichi_foam` is `taichi-foam`."""

from taichi_foam.cli import main

if __name__ == "__main__":
    main()
