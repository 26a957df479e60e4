import numpy as np
import pytest

from pd_editor.analysis.metrics.distribution_distance import histogram_of
from pd_editor.experiments.evaluation.method import Method
from pd_editor.generation.lane_follower import LaneFollower
from reproduction.claims import claims_table
from reproduction.measures import MeasuredValue, RowTable, TableLine
from reproduction.paper_tables import (
    STATE_COLUMNS,
    TRAJECTORY_COLUMNS,
    state_tables,
    text_of,
    trajectory_tables,
)
from reproduction.plans import Entry, Mode

NUM_SCENES, NUM_AGENTS = 8, 20
PD, PAPER = (
    TableLine(system="pd", mode="unguided"),
    TableLine(system="paper", mode="unguided"),
)
GT = TableLine(system="ground-truth", mode="")


def entry(system: str, seed: int = 0, mode: Mode = "unguided") -> Entry:
    method = Method(
        name=f"{system}{seed}{mode}", make_generator=lambda _: LaneFollower()
    )
    return Entry(system=system, seed=seed, mode=mode, method=method)


ENTRIES = (
    entry("ground-truth", mode=""),
    entry("pd", 0),
    entry("pd", 1),
    entry("paper", 0),
    entry("pd", 0, "guided"),
)
SHIFTS = (0.0, 1.0, 3.0, 6.0, 0.0)
"""What is added to the values of the log, for each entry."""


def rows(metrics=("speed",), is_plain=True) -> RowTable:
    """Values of the log from 0 to 20, and the same shifted."""
    random = np.random.default_rng(0)
    log = random.uniform(0, 20, NUM_SCENES * NUM_AGENTS)
    values = np.concatenate([log + shift for shift in SHIFTS])
    count = len(values)
    column = [float(one) for one in values]
    lists: list[list[float] | None] = [[one, one] for one in column]
    columns: dict[str, np.ndarray | list[list[float] | None]] = {
        name: lists if name == "local_density" else values for name in metrics
    }
    return RowTable(
        entries=ENTRIES,
        scene=np.tile(np.repeat(np.arange(NUM_SCENES), NUM_AGENTS), len(ENTRIES)),
        entry=np.repeat(np.arange(len(ENTRIES)), len(log)),
        is_plain=np.full(count, is_plain),
        is_sample=np.ones(count, bool),
        is_whole=np.ones(count, bool),
        columns=columns,
        num_scenes=NUM_SCENES,
        seed=0,
    )


def test_a_mean_is_over_scenes_and_trainings_and_so_is_its_interval():
    table = rows()
    log = table.mean("speed", GT, plain=True)
    pd = table.mean("speed", PD, plain=True)
    assert pd.value == pytest.approx(log.value + 2)
    assert pd.low < log.value + 1.2 and pd.high > log.value + 2.8  # noqa: PT018
    # Of one training the scenes alone vary.
    one = table.mean("speed", PAPER, plain=True)
    assert one.high - one.low == pytest.approx(log.high - log.low, rel=0.01)
    assert pd.high - pd.low > one.high - one.low


def test_a_difference_resamples_scenes_together():
    table = rows()
    apart = table.difference("speed", PAPER, GT, plain=True)
    assert (apart.value, apart.low, apart.high) == pytest.approx((6.0, 6.0, 6.0))
    trained = table.difference("speed", PD, GT, plain=True)
    assert trained.value == pytest.approx(2.0)
    assert (trained.low, trained.high) == pytest.approx((1.0, 3.0))


def test_nothing_is_known_of_rows_that_are_not_there():
    table = rows()
    assert np.isnan(table.mean("speed", PD, plain=False).value)
    absent = TableLine(system="vd", mode="guided")
    assert np.isnan(table.mean("speed", absent, plain=True).value)
    assert np.isnan(table.difference("speed", PD, absent, plain=True).value)


def test_distances_grow_with_the_shift_and_the_log_has_the_floor():
    table, histogram = rows(), histogram_of("speed", "ours")
    floor = table.distance(histogram, GT).value
    same = table.distance(histogram, TableLine(system="pd", mode="guided"))
    near, far = table.distance(histogram, PD), table.distance(histogram, PAPER)
    assert same.value == 0.0
    assert 0 < floor < near.value < far.value
    assert near.low <= near.value <= near.high
    assert far.low < far.value < far.high
    assert np.isnan(table.discrepancy(("speed",), GT, plain=True).value)
    assert (
        table.discrepancy(("speed",), PAPER, plain=True).value
        > table.discrepancy(("speed",), PD, plain=True).value
        > 0.005
    )


def test_the_tables_have_all_rows_and_both_kinds_of_columns():
    paper, corrected = state_tables(rows(STATE_COLUMNS))
    names = [row[0] for row in paper.rows]
    assert names == ["GT", "PD, raw", "PD as in the paper, raw", "PD, guided"]
    assert "MMD^2" in paper.header and "Collision Rate, %" in paper.header  # noqa: PT018
    assert "boxes overlap, %" in corrected.header
    assert paper.rows[1][1] == "2"
    assert "[" in paper.rows[1][2]
    plain, warped = rows(TRAJECTORY_COLUMNS), rows(TRAJECTORY_COLUMNS, is_plain=False)
    found = trajectory_tables(warped, warped, warped=True, saw_warps={"paper"})
    assert len(found) == 8
    by_title = {one.title: one for one in found}
    perturbed = by_title[
        "Table III: realism and road compliance, corrected, map perturbation"
    ]
    assert perturbed.rows[2][0] == "PD as in the paper, unguided (saw warped roads)"
    assert not by_title[
        "Table IV: comparison with the log, corrected, no map perturbation"
    ].rows
    assert len(trajectory_tables(plain, plain, warped=False)) == 4


def test_claims_are_told_whichever_way_they_come_out():
    def table(shift_of_pd: float) -> RowTable:
        one = rows(("init_overlap",))
        other = (
            entry("ground-truth", mode=""),
            entry("mha", 0),
            entry("mha", 1),
            entry("pd", 0),
            entry("pd_minus_cdb", 0),
        )
        values = one.columns["init_overlap"].copy()
        values[one.entry == 3] += shift_of_pd
        return RowTable(
            **{
                **{name: getattr(one, name) for name in one.__dataclass_fields__},
                "entries": other,
                "columns": {"init_overlap": values},
            }
        )

    empty = rows(("lateral_deviation_final", "new_overlap"))
    for shift, verdict in ((0.0, "the opposite"), (-20.0, "holds"), (-4.5, "open")):
        lines = claims_table(table(shift), empty).rows
        first = next(line for line in lines if line[4] == "PD against MHA")
        assert first[-1] == verdict, first


def test_values_in_text():
    assert text_of(MeasuredValue(value=np.nan)) == "-"
    assert text_of(MeasuredValue(value=0.1234)) == "0.123"
    assert text_of(MeasuredValue(value=12.34, low=1.0, high=20.0)) == "12.3 [1.0, 20.0]"
