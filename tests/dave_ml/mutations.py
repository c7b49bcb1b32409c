"""Mutated DAVE-ML files: random changes, and files meant to exhaust the reader."""

import re
from collections.abc import Callable
from random import Random

ELEMENT = re.compile(
    rb"<(\w+)[^<>]*(?:/>|>[^<>]*</\1>)|<(function|variableDef|staticShot|apply|piece)\b.*?</\2>", re.DOTALL
)
ATTRIBUTE = re.compile(rb'\s([\w:]+)="([^"]*)"')
NUMBER = re.compile(rb"[-+]?\d*\.?\d+")
NAMED = re.compile(rb"<ci>\s*(\w+)\s*</ci>")
STRANGE = [
    b"nan",
    b"inf",
    b"-inf",
    b"NaN",
    b"1e999",
    b"-1e308",
    b"1e-320",
    b"",
    b"0x10",
    b"1_000",
    b"1,2",
    b"--3",
    b"1e",
    b"\xef\xbc\x91",
    b"0",
]


def _spot(draw: Random, pattern: re.Pattern[bytes], text: bytes) -> re.Match[bytes] | None:
    """A match at or after a random place."""
    start = draw.randrange(len(text))
    return pattern.search(text, start) or pattern.search(text)


def _replaced(text: bytes, start: int, end: int, new: bytes) -> bytes:
    return text[:start] + new + text[end:]


def flipped(draw: Random, text: bytes) -> bytes:
    data = bytearray(text)
    for _ in range(draw.choice([1, 1, 3, 20])):
        data[draw.randrange(len(data))] = draw.randrange(256)
    return bytes(data)


def cut(draw: Random, text: bytes) -> bytes:
    start = draw.randrange(len(text))
    return text[:start] if draw.random() < 0.3 else _replaced(text, start, start + draw.randrange(1, 200), b"")


def inserted(draw: Random, text: bytes) -> bytes:
    start = draw.randrange(len(text))
    return _replaced(
        text,
        start,
        start,
        draw.choice([b"<", b">", b"&", b"<!--", b"]]>", b"\0", b"&x;", b"<a>", b"</ci>", b'"', b"<?x?>"]),
    )


def element_gone(draw: Random, text: bytes) -> bytes:
    match = _spot(draw, ELEMENT, text)
    return text if match is None else _replaced(text, *match.span(), b"")


def element_twice(draw: Random, text: bytes) -> bytes:
    match = _spot(draw, ELEMENT, text)
    return text if match is None else _replaced(text, match.end(), match.end(), match[0] * draw.choice([1, 1, 50]))


def element_moved(draw: Random, text: bytes) -> bytes:
    target, source = _spot(draw, ELEMENT, text), _spot(draw, ELEMENT, text)
    return text if target is None or source is None else _replaced(text, *target.span(), source[0])


def attribute_gone(draw: Random, text: bytes) -> bytes:
    match = _spot(draw, ATTRIBUTE, text)
    return text if match is None else _replaced(text, *match.span(), b"")


def attribute_changed(draw: Random, text: bytes) -> bytes:
    target, source = _spot(draw, ATTRIBUTE, text), _spot(draw, ATTRIBUTE, text)
    if target is None or source is None:
        return text
    new = draw.choice([source[2], b"", b"nothing", b"-1", b"nan", b"1e400", b"both", b"cubicSpline", b"x" * 5000])
    return _replaced(text, *target.span(2), new)


def attribute_renamed(draw: Random, text: bytes) -> bytes:
    target, source = _spot(draw, ATTRIBUTE, text), _spot(draw, ATTRIBUTE, text)
    return text if target is None or source is None else _replaced(text, *target.span(1), source[1])


def tag_renamed(draw: Random, text: bytes) -> bytes:
    target, source = _spot(draw, ELEMENT, text), _spot(draw, ELEMENT, text)
    if target is None or source is None or not target[1] or not source[1]:
        return text
    return _replaced(text, *target.span(), target[0].replace(target[1], source[1]))


def numbers_changed(draw: Random, text: bytes) -> bytes:
    for _ in range(draw.choice([1, 1, 10])):
        match = _spot(draw, NUMBER, text)
        if match is not None:
            text = _replaced(text, *match.span(), draw.choice(STRANGE))
    return text


def names_changed(draw: Random, text: bytes) -> bytes:
    """Replace variables in formulas; mostly makes cycles."""
    variables = re.findall(rb'varID="(\w+)"', text) or [b"x"]
    for _ in range(draw.choice([1, 3, 30])):
        match = _spot(draw, NAMED, text)
        if match is not None:
            text = _replaced(text, *match.span(1), draw.choice([*variables, b"missing"]))
    return text


def with_entities(draw: Random, text: bytes) -> bytes:
    bomb = b'<!ENTITY a0 "ha">' + b"".join(b'<!ENTITY a%d "%s">' % (k, b"&a%d;" % (k - 1) * 10) for k in range(1, 12))
    subset = draw.choice(
        [
            bomb,
            b'<!ENTITY x SYSTEM "file:///etc/passwd">',
            b'<!ENTITY % x SYSTEM "http://localhost:9/x.dtd"> %x;',
            b'<!ATTLIST variableDef units CDATA "ft">',
            b'<!ENTITY x "' + b"a" * 100_000 + b'">',
        ]
    )
    document = b"<!DOCTYPE DAVEfunc [" + subset + b"]>"
    text = re.sub(rb"<!DOCTYPE.*?>", lambda _: document, text, count=1, flags=re.DOTALL)
    return text.replace(b"</description>", draw.choice([b"&a11;", b"&x;" * 1000, b""]) + b"</description>", 1)


def nested(draw: Random, text: bytes) -> bytes:
    depth = draw.choice([50, 90, 120, 1000, 100_000])
    opening, closing = draw.choice(
        [
            (b"<apply><minus/>", b"</apply>"),
            (b"<piecewise><otherwise>", b"</otherwise></piecewise>"),
            (b"<a>", b"</a>"),
        ]
    )
    return text.replace(b"<cn>", opening * depth + b"<cn>", 1).replace(b"</cn>", b"</cn>" + closing * depth, 1)


def enormous(draw: Random, text: bytes) -> bytes:
    """Up to 100 MB of additional content."""
    end = text.rindex(b"</DAVEfunc>")
    size = draw.choice([15_000_000, 15_000_000, 100_000_000])
    piece = draw.choice(
        [
            b" ",
            b"1 ",
            b"<!-- comment -->",
            b"<a/>",
            b'<variableDef name="a" varID="a" units="nd"/>',
            b"<description>&lt;</description>",
            b"<function name='f'><independentVarPts varID='a'>" + b"1 " * 1000 + b"</independentVarPts></function>",
            b"\xe2\x82\xac",
        ]
    )
    filling = piece * (size // len(piece))
    if piece == b"1 ":
        filling = b"<breakpointDef bpID='many'><bpVals>" + filling + b"</bpVals></breakpointDef>"
    if draw.random() < 0.2:
        filling = b"<a " + b" ".join(b'a%d=">"' % k for k in range(size // 20)) + b"/>"
    return text[:end] + filling + text[end:]


def encoded(draw: Random, text: bytes) -> bytes:
    name = draw.choice([b"utf-16", b"utf-7", b"cp1252", b"hex", b"rot13", b"big5", b"unknown", b"utf-32", b"idna"])
    text = re.sub(rb"<\?xml.*?\?>", b'<?xml version="1.0" encoding="' + name + b'"?>', text, count=1)
    if draw.random() < 0.5:
        return text.decode("utf-8", "replace").encode(draw.choice(["utf-16", "utf-8-sig", "utf-32", "utf-16-le"]))
    return text


def nonsense(draw: Random, _text: bytes) -> bytes:
    return draw.choice(
        [b"", b" ", b"<a/>", b"not XML", draw.randbytes(1000), b"\0" * 1000, b"<DAVEfunc/>", b"<" * 100_000, b"{}"]
    )


MUTATIONS: list[tuple[Callable[[Random, bytes], bytes], float]] = [
    (flipped, 10), (cut, 10), (inserted, 8), (element_gone, 12), (element_twice, 10), (element_moved, 10),
    (attribute_gone, 8), (attribute_changed, 12), (attribute_renamed, 4), (tag_renamed, 6), (numbers_changed, 15),
    (names_changed, 12), (with_entities, 4), (nested, 4), (enormous, 0.8), (encoded, 3), (nonsense, 1.5),
]  # fmt: skip


def mutated(seed: int, files: list[bytes]) -> tuple[str, bytes]:
    """A file after one to four mutations, with their names."""
    draw = Random(seed)
    text = draw.choice(files)
    mutations = draw.choices(
        [mutation for mutation, _ in MUTATIONS], [weight for _, weight in MUTATIONS], k=draw.choice([1, 1, 2, 4])
    )
    for mutation in mutations:
        if b"</DAVEfunc>" in text and len(text) < 14_000_000:
            text = mutation(draw, text)
    return "+".join(mutation.__name__ for mutation in mutations), text
