"""What the strip of samples shows, and what it does with the page's events."""

import time
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from pd_editor.editor.commands import traffic_command
from pd_editor.editor.library.thumbnail import PictureFrame
from pd_editor.editor.variant import Variant
from pd_editor.scene.generation import GeneratedTraffic, GenerationRequest
from pd_editor.viewer.generation.sample_strip import (
    SampleCards,
    SampleSet,
    SampleStrip,
    card_lines,
)
from pd_editor.viewer.scene.viewpoint import Viewpoint
from pd_editor.viewer.tab.tab_model import TabModel
from pd_editor.viewer.tab.ui_context import UiContext
from tests.analysis.findings.builders import finding
from tests.analysis.findings.test_sample_ranking import PLAIN
from tests.analysis.metrics.traffic_builders import sample_of
from tests.builders import scenario_with, straight_drivers, two_agents_that_pass
from tests.viewer.fake_page import FakePage


def test_the_pictures_hold_the_agents_of_all_samples_and_the_focal_agent():
    """They showed what was around the agents of the first sample."""
    near, far = (
        scenario_with(straight_drivers([(0.0, 0.0, 0.0, 0.0), (x_m, 0.0, 0.0, 0.0)]))
        for x_m in (20.0, 120.0)
    )
    frame = PictureFrame.around_agents([(near, ("101",)), (far, ("101",))])
    (x, y), (half_width, half_height) = frame.middle_m, frame.half_size_m
    for place in ((0.0, 0.0), (20.0, 0.0), (118.0, 0.0)):
        assert abs(place[0] - x) < half_width
        assert abs(place[1] - y) < half_height
    # A picture of a few agents is no closer than any other.
    assert PictureFrame.around_agents([(near, ())]).scale == 1.0


def test_one_car_far_from_the_road_does_not_empty_the_picture():
    """A parked car 140 m beside the mapped road left half of each picture empty."""
    states = [(0.0, 0.0, 0.0, 0.0), (20.0, 0.0, 0.0, 0.0), (10.0, 140.0, 0.0, 0.0)]
    usual, far = (
        PictureFrame.around_agents([(one, one.agents.ids)])
        for one in (scenario_with(straight_drivers(states[:n])) for n in (2, 3))
    )
    assert far == usual


class Tab(UiContext):
    """Runs actions at once and keeps notices."""

    def __init__(self, page):
        self.overlay, self.model = page, TabModel(SimpleNamespace(is_dark=False))
        self.notices, self.errors = [], []
        self.session = SimpleNamespace(variant=Variant())

    def post(self, action, merge_key=None, *, failure=None):
        action()

    def notify(self, title, body="", tone="info", *, stays=False):
        self.notices.append(title)

    def report(self, error):
        self.errors.append(error)


class Still(Viewpoint):
    """A viewpoint that does not move."""

    def __init__(self):
        pass

    def uncover(self):
        pass


@pytest.fixture
def page():
    return FakePage()


@pytest.fixture
def tab(page):
    return Tab(page)


@pytest.fixture
def drawn(tab):
    drawn = []
    tab.model.sample_pointed.subscribe(lambda: drawn.append(1))
    return drawn


@pytest.fixture
def strip(tab, drawn):
    strip = SampleStrip(tab, Still())
    strip.told = []
    strip.adopted.subscribe(strip.told.append)
    return strip


def opened(strip, page, count=3):
    """A run of some samples, the first of which is in force."""
    scenario = two_agents_that_pass()
    agents, now = scenario.agents, scenario.current_step
    steps = scenario.time_axis.num_future_steps + 1
    start = agents.position_m[:, now][:, None].repeat(steps, axis=1)
    samples = []
    for index in range(count):
        path = start.copy()
        path[..., 0] += 0.1 * (1 + index) * np.arange(steps)
        samples.append(sample_of(agents.ids, path, agents.kinds))
    request = GenerationRequest(
        scenario=scenario, agent_ids=agents.ids, num_samples=count
    )
    traffic = GeneratedTraffic(samples=tuple(samples), generator="fake")
    strip.open(
        SampleSet(
            before=scenario,
            base=scenario,
            done=(),
            samples=traffic.samples,
            commands=tuple(traffic_command(request, traffic, n) for n in range(count)),
        )
    )
    strip.follow(0, is_valid=True)
    end = time.monotonic() + 60
    while not page.shown["samples"]["isOpen"] and time.monotonic() < end:
        time.sleep(0.01)
    assert strip.is_open
    return page.shown["samples"]


def test_cards_are_ranked_and_marked(strip, page):
    shown = opened(strip, page)
    assert sorted(card["index"] for card in shown["cards"]) == [0, 1, 2]
    assert [card["index"] for card in shown["cards"] if card["isAdopted"]] == [0]
    assert len(page.shown["sample-pictures"]["pictures"]) == 3
    hear = partial(page.send, "samples")
    hear({"kind": "rank", "value": "movement"})
    cards = page.shown["samples"]["cards"]
    assert [card["index"] for card in cards] == [2, 1, 0]
    assert [card["mark"].split()[-1] for card in cards] == ["1.", "2.", "3."]
    assert [card["index"] for card in cards if "in use" in card["mark"]] == [0]
    hear({"kind": "pick", "value": 2})
    assert len(page.shown["samples"]["cards"]) == 2
    hear({"kind": "pick", "value": 0})
    assert len(page.shown["samples"]["cards"]) == 3


def test_pointing_previews_and_a_click_adopts(strip, page, drawn, tab):
    opened(strip, page)
    hear = partial(page.send, "samples")
    hear({"kind": "point", "value": 2})
    assert tab.model.sample is not None
    assert len(drawn) == 1
    hear({"kind": "point", "value": 2})
    assert len(drawn) == 1
    hear({"kind": "leave"})
    assert tab.model.sample is None
    hear({"kind": "adopt", "value": 1})
    hear({"kind": "adopt", "value": 0})
    assert strip.told == [1]
    for value in (-1, 3, "1", None, 10**30, [1]):
        for kind in ("point", "adopt", "keep", "pair", "rank", "pick"):
            hear({"kind": kind, "value": value})
    assert strip.told == [1]
    assert tab.model.sample is None


def test_a_sample_is_compared_with_the_one_in_use(strip, page):
    opened(strip, page)
    page.send("samples", {"kind": "pair", "value": 2})
    pair = page.shown["pair"]
    assert [one["index"] for one in pair["sides"]] == [0, 2]
    left, right = (one["agents"][0]["path"] for one in pair["sides"])
    assert len(left) == len(right) == 3 * 61
    assert left[:2] == right[:2]
    assert left != right
    page.send("pair", {"kind": "use", "value": 2})
    assert strip.told == [2]
    assert not page.shown["pair"]["isOpen"]
    page.send("samples", {"kind": "pair", "value": 1})
    assert strip.close(), "the comparison is closed first"
    assert strip.is_open
    assert strip.close()
    assert not strip.is_open
    assert not strip.close()


def test_the_key_compares_whatever_is_pointed_at(strip, page, tab):
    """It worked on cards with the focus only, and not at all on the one in use."""
    strip.compare()
    assert tab.notices == ["No samples to choose among"]
    opened(strip, page)
    best, *_ = (one["index"] for one in page.shown["samples"]["cards"] if one["index"])

    def compared():
        strip.compare()
        return [one["index"] for one in page.shown["pair"]["sides"]]

    page.send("samples", {"kind": "point", "value": 2})
    assert compared() == [0, 2]
    strip.compare()
    assert not page.shown["pair"]["isOpen"]
    page.send("samples", {"kind": "point", "value": 0})
    assert compared() == [best, 0]
    assert strip.close()
    page.send("samples", {"kind": "leave"})
    assert compared() == [best, 0]


def test_cards_count_collisions_with_agents_that_appear_later():
    """(W14) A card told "No collisions" beside a problem of the same sample."""
    # One agent keeps its trajectory: without it, who appears later would be left out.
    agents = straight_drivers([(0, 0, 0, 5), (20, 0, 0, 0), (0, 50, 0, 5)])
    is_valid = agents.is_valid.copy()
    is_valid[1, :60] = False
    scenario = scenario_with(agents.with_rows(np.arange(3), is_valid=is_valid))
    (driver, _, _), now = agents.ids, scenario.current_step
    sample = sample_of((driver,), agents.position_m[:1, now:])
    request = GenerationRequest(scenario=scenario, agent_ids=(driver,))
    traffic = GeneratedTraffic(samples=(sample,), generator="fake")
    cards = SampleCards.of(
        SampleSet(
            before=scenario,
            base=scenario,
            done=(),
            samples=traffic.samples,
            commands=(traffic_command(request, traffic),),
        )
    )
    assert cards.numbers[0].num_collisions == 1


def test_any_two_samples_are_compared(strip, page):
    """(W13) Each side has a menu of all samples; the one of the other side swaps."""
    opened(strip, page)
    hear = partial(page.send, "pair")

    def sides() -> list[int]:
        return [one["index"] for one in page.shown["pair"]["sides"]]

    page.send("samples", {"kind": "pair", "value": 2})
    assert sides() == [0, 2]
    offered = page.shown["pair"]["offered"]
    assert sorted(one["value"] for one in offered) == [0, 1, 2]
    assert [one["value"] for one in offered if "in use" in one["text"]] == [0]
    hear({"kind": "choose", "side": 0, "value": 1})
    assert sides() == [1, 2]
    hear({"kind": "choose", "side": 1, "value": 1})
    assert sides() == [2, 1]
    for side, value in ((0, 3), (0, -1), (2, 0), (None, 0), (1, "0"), ([0], 0)):
        hear({"kind": "choose", "side": side, "value": value})
    assert sides() == [2, 1]
    assert not strip.told
    # The one in use is compared with the best other one.
    page.send("samples", {"kind": "pair", "value": 0})
    assert sides() == [offered[0]["value"] or offered[1]["value"], 0]


def test_the_strip_hides_and_comes_back_with_the_state(strip, page, tab):
    opened(strip, page)
    page.send("samples", {"kind": "point", "value": 1})
    strip.follow(None, is_valid=False)
    assert not page.shown["samples"]["isOpen"]
    strip.follow(None, is_valid=True)
    assert page.shown["samples"]["isOpen"]
    strip.close()
    strip.follow(0, is_valid=True)
    assert not page.shown["samples"]["isOpen"]
    strip.focus()
    assert page.shown["samples"]["takesFocus"]
    strip.forget()
    assert tab.model.sample is None
    strip.focus()
    assert tab.notices == ["No samples to choose among"]


def test_three_lines():
    def texts(kinds, numbers=PLAIN, ranking="realism"):
        found = [finding(kind, str(n)) for n, kind in enumerate(kinds)]
        return [line.text for line in card_lines(found, numbers, ranking)]

    moves = "50 % move, 8.0 m/s"
    assert texts([]) == ["No new problems", "No notices", moves]
    assert texts(["harsh-motion"]) == ["No new problems", "1 notice", moves]
    several = ["later-collision", "off-road", "later-off-road", "harsh-motion"]
    assert texts(several) == ["3 problems", "1 collision, 2 off-road", moves]
    assert texts(["collision"] * 5)[1] == "5 collisions"
    assert texts(["friction", "friction"])[:2] == ["2 problems", "2 too fast"]
    kinds = ["sharp-road", "against-traffic", "impossible-motion", "guidance-not-met"]
    words = ["sharp bend", "against traffic", "impossible", "unmet guidance"]
    assert [texts([kind])[1] for kind in kinds] == [f"1 {one}" for one in words]
    (line, *_) = card_lines([finding("collision", "a")], PLAIN, "interaction")
    assert (line.text, line.tone) == ("1 problem", "bad")
    assert texts([], ranking="interaction")[2] == "2.0 s to collision"
    never = replace(PLAIN, time_to_collision_s=None)
    assert texts([], never, "interaction")[2] == "no collision course"
