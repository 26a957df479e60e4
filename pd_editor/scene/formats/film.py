"""Films of scenes seen from above: MP4, WebM or GIF, without a screen recorder."""

import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, Final

import numpy as np
from jaxtyping import Float, UInt8

from pd_editor.base.errors import ExportError
from pd_editor.scene.formats.figure import RADIUS_M, check_view
from pd_editor.scene.palette import parts_of_one
from pd_editor.scene.policy import DrivenPlans, plans_at
from pd_editor.scene.scenario import Scenario
from pd_editor.scene.top_view import DPI, Frame, TopView, middle_of, pixels

FRAMES_PER_S: Final = 20
_GIF_FRAMES_PER_S: Final = 10
_ASPECT: Final = 16 / 9
_MARGIN_M: Final = 15.0
_LEAST_PX, _MOST_PX = 120, 2160
_MOST_CREDIT: Final = 80
_CODECS: Final = {
    "mp4": ("libx264", {"crf": "21", "preset": "veryfast"}),
    "webm": (
        "libvpx-vp9",
        {"crf": "33", "b": "0", "deadline": "realtime", "cpu-used": "8", "row-mt": "1"},
    ),
}
Told = Callable[[int, int], None]
"""Takes the number of frames that are done, and that of all."""
_Picture = UInt8[np.ndarray, "H W 4"]


@dataclass(frozen=True, kw_only=True)
class FilmLook:
    """What a film shows, and how large it is."""

    follow: str = ""
    """Agent that stays in the middle; empty: the picture stands and holds the focal one."""
    radius_m: float = RADIUS_M
    """Half of the shown height; more where the focal agent would leave it."""
    height_px: int = 1080
    """The width is 16/9 of it."""
    plans: DrivenPlans = field(default_factory=dict)
    """What policies planned; drawn as lines while it was in force."""


def film(
    scenario: Scenario,
    ending: str,
    look: FilmLook = FilmLook(),
    on_progress: Told = lambda _done, _all: None,
) -> bytes:
    """Draw a scene in real time, from its first step to its last.

    Raises:
        ExportError: an agent or a size that cannot be drawn.
    """
    check_view(scenario, look.follow, look.radius_m)
    if not _LEAST_PX <= look.height_px <= _MOST_PX:
        raise ExportError(
            f"A film is {_LEAST_PX} to {_MOST_PX} pixels high, not {look.height_px}."
        )
    rate = _GIF_FRAMES_PER_S if ending == "gif" else FRAMES_PER_S
    span = scenario.last_step - scenario.first_step
    count = round(span * scenario.time_axis.step_s * rate) + 1
    steps = np.linspace(scenario.first_step, scenario.last_step, count)
    pictures = _Camera(scenario, look).pictures(steps)
    encode = _as_gif if ending == "gif" else _as_video
    return encode(_told(pictures, count, on_progress), rate, ending)


def _told(
    pictures: Iterator[_Picture], count: int, on_progress: Told
) -> Iterator[_Picture]:
    for number, picture in enumerate(pictures):
        yield picture
        on_progress(number + 1, count)


class _Camera:
    """Draws the road once for each place, and the traffic on it at each step."""

    def __init__(self, scenario: Scenario, look: FilmLook) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self._scenario, self._follow = scenario, look.follow
        self._plans = look.plans
        # Encoders need even sizes.
        height = look.height_px // 2 * 2
        self._size = np.array([round(height * _ASPECT / 2) * 2, height])
        self._middle, radius_m = _standing(scenario, look)
        self._per_m = height / (2 * radius_m)
        self._half_m = self._size / (2 * self._per_m)
        self._view = TopView(scenario, self._per_m * 72 / DPI)
        sheet = Figure(tuple(self._size / DPI), dpi=DPI)
        self._canvas = FigureCanvasAgg(sheet)
        self._axes = sheet.add_axes((0, 0, 1, 1))
        self._credit = (scenario.provenance.attribution or "")[:_MOST_CREDIT]
        self._ground: tuple[np.ndarray, np.ndarray] | None = None

    def pictures(self, steps: Float[np.ndarray, "N"]) -> Iterator[_Picture]:
        for step in steps:
            middle = self._middle
            if self._follow:
                middle = middle_of(self._scenario, self._follow, step)
            yield self._picture(middle, step)

    def _picture(self, middle: Float[np.ndarray, "2"], step: float) -> _Picture:
        renderer = self._canvas.get_renderer()
        shown = np.asarray(renderer.buffer_rgba())
        ground, middle = self._road_at(middle)
        shown[:] = ground
        Frame(middle_m=middle, half_m=self._half_m).show_in(self._axes)
        seconds = (step - self._scenario.current_step) * self._scenario.time_axis.step_s
        clock = f"{self._scenario.scenario_id}   t = {seconds:+.1f} s"
        told = self._text(0.012, clock), self._text(0.988, self._credit, ha="right")
        for artist in (*self._view.traffic(step), *self._planned(int(step)), *told):
            self._axes.add_artist(artist)
            artist.draw(renderer)
            artist.remove()
        return shown

    def _planned(self, step: int) -> Iterator[Any]:
        """What is planned at a step, on a rim."""
        from matplotlib.collections import LineCollection

        lines = plans_at(self._plans, self._scenario.agents, step)
        palette = self._view.palette
        for color, width_m in ((palette.lane, 0.6), (palette.plan, 0.3)):
            points = self._view.points_per_m * width_m
            yield LineCollection(lines, colors=[parts_of_one(color)], linewidths=points)

    def _text(self, x: float, words: str, **look: Any) -> Any:
        from matplotlib.text import Text

        points = 72 * self._size[1] / DPI / 40
        place = {"transform": self._axes.transAxes, "fontsize": points}
        return Text(x, 0.02, words, color="#30353d", **place, **look)

    def _road_at(
        self, middle: Float[np.ndarray, "2"]
    ) -> tuple[_Picture, Float[np.ndarray, "2"]]:
        """The picture of the road about a place, which is moved to a whole pixel."""
        grown = 2 if self._follow else 1
        if self._ground is not None:
            about, picture = self._ground
            shift = np.rint((middle - about) * self._per_m).astype(int) * (1, -1)
            begin = (np.array(picture.shape[1::-1]) - self._size) // 2 + shift
            if (begin >= 0).all() and (
                begin + self._size <= picture.shape[1::-1]
            ).all():
                (x, y), (width, height) = begin, self._size
                part = picture[y : y + height, x : x + width]
                return part, about + shift * (1, -1) / self._per_m
        width, height = (grown * self._size).tolist()
        frame = Frame(middle_m=middle, half_m=grown * self._half_m)
        color = self._view.palette.ground
        drawn = pixels(self._view.road(frame), frame, (width, height), color)
        self._ground = middle, drawn
        return self._road_at(middle)


def _standing(
    scenario: Scenario, look: FilmLook
) -> tuple[Float[np.ndarray, "2"], float]:
    """Middle and half of the height of a picture that stands still."""
    row = scenario.agents.row_of.get(scenario.focal_id)
    if look.follow or row is None:
        return middle_of(scenario, scenario.focal_id), look.radius_m
    path = scenario.agents.position_m[row, scenario.agents.is_valid[row]]
    low, high = path.min(axis=0), path.max(axis=0)
    needed = (high - low) / 2 + _MARGIN_M
    return (low + high) / 2, max(look.radius_m, needed[1], needed[0] / _ASPECT)


def _as_video(pictures: Iterator[_Picture], rate: int, ending: str) -> bytes:
    import av

    sink, (codec, options) = io.BytesIO(), _CODECS[ending]
    # Without it a WebM has a random number of its own.
    exact = {"fflags": "+bitexact"}
    with av.open(sink, "w", format=ending, options=exact) as container:
        stream: Any = container.add_stream(codec, rate=rate, options=options)
        stream.pix_fmt = "yuv420p"
        stream.time_base = Fraction(1, rate)
        for number, picture in enumerate(pictures):
            if not number:
                stream.height, stream.width = picture.shape[:2]
            frame = av.VideoFrame.from_ndarray(picture, format="rgba")
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return sink.getvalue()


def _as_gif(pictures: Iterator[_Picture], rate: int, ending: str) -> bytes:
    from PIL import Image

    frames: list[Any] = []
    for picture in pictures:
        image = Image.fromarray(picture[..., :3])
        # One table of colours for all frames: those that do not change stay equal.
        first = frames[0] if frames else None
        frames.append(image.quantize(128, palette=first, dither=Image.Dither.NONE))
    sink = io.BytesIO()
    rest = frames[1:]
    frames[0].save(
        sink, ending, save_all=True, append_images=rest, duration=1000 // rate, loop=0
    )
    return sink.getvalue()
