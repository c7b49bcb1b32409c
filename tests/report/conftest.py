"""The made-up flight of the report tests, and the browser that opens its page."""

import pytest

from anser.report import write_report
from support.chromium import Chromium
from support.made_flight import make_flight
from support.report_page import WINDOW


@pytest.fixture(scope="session")
def flight():
    return make_flight()


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Chromium(tmp_path_factory.mktemp("chromium"), *WINDOW, software=True) as opened:
        yield opened


@pytest.fixture(scope="session")
def path(flight, tmp_path_factory):
    """Report page of the made-up flight."""
    page_path = tmp_path_factory.mktemp("page") / "report.html"
    write_report(*flight, page_path)
    return page_path
