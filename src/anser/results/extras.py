"""Libraries that anser can do without, and how to get them."""


def missing(library: str, extra: str) -> str:
    """Say that a library is not installed, and how to get it: by which extra of anser."""
    return f'{library} is not installed: pip install "anser[{extra}]" (in a clone: pip install -e ".[{extra}]")'
