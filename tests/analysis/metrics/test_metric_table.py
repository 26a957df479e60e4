import csv
from pathlib import Path
from typing import get_args

from pd_editor.analysis.metrics import values
from pd_editor.analysis.metrics.values import METRICS, Better, Source


def test_each_row_of_the_table_is_a_metric_that_can_be_read():
    with Path(values.__file__).with_name("metric_table.csv").open(newline="") as file:
        names = [row["name"] for row in csv.DictReader(file)]
    assert names == list(METRICS)
    for metric in METRICS.values():
        assert metric.source in get_args(Source)
        assert metric.better in get_args(Better)
        assert metric.unit
        assert metric.definition.rstrip(")").endswith(".")
