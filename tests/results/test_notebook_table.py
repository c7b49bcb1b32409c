"""HTML table for a notebook, from plain text."""

import xml.etree.ElementTree as ElementTree

from anser.results.documents import notebook_table


def test_a_table_has_title_and_notes_with_escaped_text():
    page = ElementTree.fromstring(
        notebook_table("<a> & b", [{"x": "1", "y<": "2"}, {"x": "3", "y<": "<b>"}], ["n > 1"])
    )
    assert page.find("p/b").text == "<a> & b"
    assert [cell.text for cell in page.iter("th")] == ["x", "y<"]
    assert [cell.text for cell in page.iter("td")] == ["1", "2", "3", "<b>"]
    assert page.findall("p")[-1].text == "n > 1"


def test_a_table_without_rows_is_omitted():
    assert "<table>" not in notebook_table("no plan", [], ["why"])
