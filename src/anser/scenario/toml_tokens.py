"""Tokens of TOML, found in time proportional to the text: how deep its keys and values are, where a value ends."""

import re
from typing import Final

DEPTH_MAX: Final = 32
"""Parts of a dotted key, and lists and tables within each other; files of anser have up to six."""

_BASIC = r'"(?:[^"\\\n]|\\.)*+"'
_LITERAL = r"'[^'\n]*+'"
KEY_PART: Final = rf"(?:[A-Za-z0-9_-]++|{_BASIC}|{_LITERAL})"
DOTTED_KEY: Final = rf"{KEY_PART}(?:[ \t]*+\.[ \t]*+{KEY_PART})*+"
_TOKEN = re.compile(
    r'"""(?:[^"\\]|\\.|"(?!""))*+(?:"{3,5}|\Z)'
    r"|'''(?:[^']|'(?!''))*+(?:'{3,5}|\Z)"
    rf"|\#[^\n]*+|(?P<key>{DOTTED_KEY})|(?P<open>[\[{{])|(?P<close>[\]}}])|(?P<line>\n)"
    r"""|[^"'#\[\]{}\nA-Za-z0-9_-]++|.""",
    re.DOTALL,
)


def excessive_depth(text: str) -> int | None:
    """Position of the first key, list or table deeper than `DEPTH_MAX`; None if there is none."""
    depth = 0
    for token in _TOKEN.finditer(text):
        match token.lastgroup:
            case "key" if token.end() - token.start() > 2 * DEPTH_MAX and len(key_parts(token[0])) > DEPTH_MAX:
                return token.start()
            case "open":
                depth += 1
                if depth > DEPTH_MAX:
                    return token.start()
            case "close":
                depth = max(depth - 1, 0)
            case _:
                pass
    return None


def end_of_value(text: str, start: int) -> int:
    """Position of the end of the line on which the value that begins at `start` ends, in a valid text."""
    depth = 0
    for token in _TOKEN.finditer(text, start):
        match token.lastgroup:
            case "open":
                depth += 1
            case "close":
                depth -= 1
            case "line" if depth == 0:
                return token.start()
            case _:
                pass
    return len(text)


def key_parts(dotted: str) -> list[str]:
    """Parts of a dotted key, as the text has them."""
    return re.findall(KEY_PART, dotted)
