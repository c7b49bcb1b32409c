"""Charts of report pages: arrivals exactly on time."""

from anser.report.svg_charts import arrival_strip


def test_arrivals_without_any_error_are_drawn():
    aircraft = [{"name": name, "arrival_s": 60.0, "planned_arrival_s": 60.0} for name in ("anna", "bert")]
    chart = arrival_strip({"aircraft": aircraft})
    assert chart.count("<circle") == 2
    assert "nan" not in chart
