"""Input files: size limits before reading, and the encoding of XML."""

import codecs
import resource
import runpy
from pathlib import Path

import pytest

from anser.aircraft_files import read_airframe
from anser.config import ScenarioError
from anser.files import XML_ENCODINGS, decode_xml, read_file
from anser.results.checksums import read_document


def _sparse(path, size=1 << 40):
    with path.open("wb") as file:
        file.truncate(size)
    return path


def test_a_file_is_read_up_to_its_greatest_size_only(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(b"x" * 100)
    assert read_file(path, 100) == b"x" * 100
    with pytest.raises(OSError, match=r"more than 99 bytes.*file"):
        read_file(path, 99)


def test_files_of_a_terabyte_are_refused_without_reading(tmp_path, capsys):
    memory_before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(OSError, match="more than 33,554,432 bytes"):
        read_document(_sparse(tmp_path / "summary.json"))
    write_page = runpy.run_path(str(Path(__file__).parents[1] / "docs" / "verification_page.py"))["_main"]
    assert write_page([str(_sparse(tmp_path / "verification.json")), str(tmp_path)]) == 2
    assert "more than 67,108,864 bytes" in capsys.readouterr().err
    for name in ("aircraft.toml", "model.dml"):
        _sparse(tmp_path / name)
    with pytest.raises(ScenarioError, match="more than 8,388,608 bytes"):
        read_airframe(tmp_path / "aircraft.toml")
    (tmp_path / "named.toml").write_text('format = 1\nname = "x"\n[dave_ml]\naerodynamics = "model.dml"\n')
    with pytest.raises(ScenarioError, match="more than 8,388,608 bytes"):
        read_airframe(tmp_path / "named.toml")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory_before < 400_000  # KiB


TEXT = "<a>caf\u00e9</a>"


@pytest.mark.parametrize("encoding", [name for name in XML_ENCODINGS if name not in ("US-ASCII", "UTF-16")])
def test_xml_is_read_in_the_encoding_that_it_declares(encoding):
    text = f'<?xml version="1.0" encoding="{encoding}"?>{TEXT}'
    assert decode_xml(text.encode(encoding)) == text


def test_xml_without_a_declaration_is_utf_8_or_marked_utf_16():
    for content in (TEXT.encode(), codecs.BOM_UTF8 + TEXT.encode(), TEXT.encode("utf-16")):
        assert decode_xml(content) == TEXT


@pytest.mark.parametrize("name", ["punycode", "idna", "undefined", "hex", "rot13", "unicode_escape", "utf-7", "none"])
def test_other_encodings_are_refused_by_name(name):
    with pytest.raises(LookupError, match=f'encoding "{name}"'):
        decode_xml(f"<?xml version='1.0' encoding='{name}'?><a/>".encode())
