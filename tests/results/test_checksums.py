"""Files of a run are verified before use: any changed byte is refused with the file's name."""

import json

import numpy as np
import pytest
import xarray as xr

from anser.results import read_netcdf, read_summary, to_dataset, write_netcdf
from anser.results.checksums import TRAILER_BYTES, DamagedFileError, add_checksum, read_document, verify_checksum


@pytest.fixture
def flight(time_s, history, names, attributes, tmp_path):
    path = tmp_path / "flight.nc"
    write_netcdf(to_dataset(time_s, history, names, attributes), path)
    return path


def test_any_changed_byte_of_a_flight_is_refused(flight):
    assert verify_checksum(flight)
    content, draw = flight.read_bytes(), np.random.default_rng(1)
    for k in (*draw.integers(0, len(content) - TRAILER_BYTES, 40), len(content) - TRAILER_BYTES - 1):
        flight.write_bytes(content[:k] + bytes([content[k] ^ 1]) + content[k + 1 :])
        with pytest.raises(DamagedFileError, match=r"flight\.nc: arrived a damaged file, whose content does not match"):
            read_netcdf(flight)


def test_a_flight_cut_anywhere_is_refused(flight):
    content = flight.read_bytes()
    for size in (0, 1, len(content) // 2, len(content) - TRAILER_BYTES, len(content) - 1):
        flight.write_bytes(content[:size])
        with pytest.raises(DamagedFileError, match=r"flight\.nc: arrived a file (that cannot be read|without its)"):
            read_netcdf(flight)


def test_a_flight_of_another_program_or_format_is_refused_and_an_older_one_is_read(flight):
    dataset = xr.load_dataset(flight, decode_timedelta=False)
    assert dataset.attrs["format_version"] == 1
    flight.unlink()
    dataset.to_netcdf(flight)
    with pytest.raises(DamagedFileError, match=r"without its checksum.*or without the attribute format_version"):
        read_netcdf(flight)
    flight.unlink()
    dataset.assign_attrs(format_version=99).to_netcdf(flight)
    with pytest.raises(DamagedFileError, match="arrived format_version 99; expected 1"):
        read_netcdf(flight)
    flight.unlink()
    del dataset.attrs["format_version"]
    dataset.to_netcdf(flight)
    np.testing.assert_array_equal(read_netcdf(flight)["north_m"], dataset["north_m"])


def test_a_changed_value_of_a_document_is_refused_unlike_a_changed_spacing(tmp_path):
    path, document = tmp_path / "some.json", {"b": [1.5, None], "a": {"text": "ü"}}
    path.write_text(json.dumps(add_checksum(document)))
    assert read_document(path) == (document, True)
    path.write_text(json.dumps(add_checksum(document), indent=3, sort_keys=True))
    assert read_document(path) == (document, True)
    path.write_text(json.dumps(add_checksum(document) | {"b": [1.25, None]}))
    with pytest.raises(DamagedFileError, match=r"some\.json: arrived a damaged file"):
        read_document(path)
    path.write_text(json.dumps(document))
    assert read_document(path) == (document, False)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "cannot be read as JSON"),
        (b"\xff\xfe", "cannot be read as JSON"),
        (b"[" * 100_000, "cannot be read as JSON"),
        (b"[1]", "JSON that is a list; expected an object"),
        (b'{"miss_m": NaN}', "NaN, which JSON has not"),
    ],
)
def test_a_file_without_document_is_refused(tmp_path, content, message):
    (tmp_path / "some.json").write_bytes(content)
    with pytest.raises(DamagedFileError, match=message):
        read_document(tmp_path / "some.json")


ROW = {"name": "a", "goal": "b", "status": "arrived", "planned_arrival_s": 1.0, "arrival_s": 1.0, "miss_m": None}
OLD = {
    "format_version": 1,
    "scenario": {"name": "old"},
    "aircraft": [ROW],
    "fleet": {"separation_min_m": None, "simulated_s": 2.0},
    "requirements": [{"name": "miss_max_m", "met": True}],
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"aircraft": None}, "arrived None in aircraft; expected a valid list"),
        ({"aircraft": []}, r"arrived \[\] in aircraft"),
        ({"aircraft": [ROW | {"arrival_s": "soon"}]}, r"arrived 'soon' in aircraft\.0\.arrival_s; expected a valid number"),
        ({"requirements": [{"name": "x"}]}, r"arrived no requirements\.0\.met"),
        ({"fleet": 3}, "arrived 3 in fleet"),
    ],
)  # fmt: skip
def test_a_complete_summary_of_an_older_version_is_read(tmp_path, change, message):
    path = tmp_path / "summary.json"
    path.write_text(json.dumps(OLD))
    assert read_summary(path) == OLD
    path.write_text(json.dumps(OLD | change))
    with pytest.raises(DamagedFileError, match=message):
        read_summary(path)
