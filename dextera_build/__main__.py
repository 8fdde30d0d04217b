"""`python -m dextera_build` is `dxb`."""

from dextera_build.cli.main import entry

if __name__ == "__main__":
    entry()
