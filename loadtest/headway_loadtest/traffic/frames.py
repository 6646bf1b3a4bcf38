"""Frames: the messages of many vehicles, in the order of their event time, a short stretch of time at a time."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from headway_loadtest.inject.apply import Label, corrupt
from headway_loadtest.inject.faults import Spec
from headway_loadtest.sources.drive import F64, I64, Drive, Scene, SourceError
from headway_loadtest.traffic.read_ahead import read_ahead

FRAME_S = 0.2
MSG_CNT_MASK = 127
PHASES_MS = 100
SCENES_AHEAD = 64

LeaderRecord = tuple[str, float, float]


class Vehicle(NamedTuple):
    """The sender of a row from now on."""

    row: int
    id: str
    length_m: float | None


@dataclass(frozen=True, slots=True)
class Frame:
    """Messages in order of event time, (n,) each. `t_us` counts from the start of the replay; `row` names the sender.

    `entering` holds for this frame and those after it. `leader` is None where no sender declares one.
    """

    entering: tuple[Vehicle, ...]
    t_us: I64
    row: I64
    msg_cnt: I64
    lat: F64
    lon: F64
    speed_mps: F64
    heading_deg: F64
    leader: list[LeaderRecord | None] | None = None

    def __len__(self) -> int:
        """How many messages."""
        return len(self.t_us)


class _Playing:
    """A drive under way: its columns in replay time, and how far it has been played."""

    def __init__(self, drive: Drive, row: int, start_us: int) -> None:
        self.drive = drive
        self.row = row
        self.t_us = start_us + np.round(drive.t_s * 1e6).astype(np.int64)
        self.next = 0

    def take(self, end_us: int) -> slice:
        start = self.next
        self.next = int(np.searchsorted(self.t_us, end_us))
        return slice(start, self.next)

    @property
    def done(self) -> bool:
        return self.next == len(self.t_us)


class SceneFrames:
    """Frames of scenes: while fewer than `concurrent` vehicles are under way, another scene enters.

    Scenes are read as they are needed, by a thread that is a few of them ahead, so that reading does not hold up
    sending. A scene enters at a phase of its own within 0.1 s, in whole milliseconds, drawn from the seed. `labels`
    fills as vehicles enter, with what is injected and with the gaps of the recordings. Each iteration starts again.
    `seconds` cuts the replay short. With `pause_s` scenes enter one by one, with that pause between them.
    """

    def __init__(
        self,
        scenes: Iterable[Scene],
        *,
        seed: int = 0,
        inject: Spec | None = None,
        concurrent: int = 500,
        seconds: float = np.inf,
        pause_s: float | None = None,
    ) -> None:
        self.labels: list[Label] = []
        self._scenes = scenes
        self._seed = seed
        self._inject = inject
        self._concurrent = concurrent
        self._seconds = seconds
        self._pause_s = pause_s

    def __iter__(self) -> Iterator[Frame]:
        self.labels.clear()
        rng = np.random.default_rng(self._seed)
        waiting = read_ahead(self._scenes, SCENES_AHEAD)
        playing: list[_Playing] = []
        entered, now_s, exhausted = 0, 0.0, False
        while now_s < self._seconds:
            entering: list[Vehicle] = []
            while not exhausted and self._has_room(playing):
                scene = next(waiting, None)
                exhausted = scene is None
                phase_us = 1000 * int(rng.integers(PHASES_MS))
                for drive in self._injected(scene or (), round(now_s * 1e6) + phase_us):
                    if any(drive.vehicle == other.drive.vehicle for other in playing):
                        raise SourceError(f"{drive.vehicle} drives twice at once: is a source named twice?")
                    entering.append(Vehicle(entered, drive.vehicle, drive.length_m))
                    playing.append(_Playing(drive, entered, round(now_s * 1e6) + phase_us))
                    entered += 1
            if not playing:
                return
            now_s += FRAME_S
            yield _frame(tuple(entering), playing, round(min(now_s, self._seconds) * 1e6))
            playing = [drive for drive in playing if not drive.done]
            if not playing:
                now_s += self._pause_s or 0.0

    def _has_room(self, playing: list[_Playing]) -> bool:
        return len(playing) < self._concurrent if self._pause_s is None else not playing

    def _injected(self, scene: Scene, start_us: int) -> Iterator[Drive]:
        for drive in scene:
            sent, labels = corrupt(drive, self._seed, self._inject)
            self.labels.extend(
                replace(label, start_us=label.start_us + start_us, stop_us=label.stop_us + start_us)
                for label in labels
                if label.start_us + start_us < 1e6 * self._seconds
            )
            yield sent


def _frame(entering: tuple[Vehicle, ...], playing: list[_Playing], end_us: int) -> Frame:
    parts = [(drive, drive.take(end_us)) for drive in playing]
    order = np.argsort(np.concatenate([drive.t_us[part] for drive, part in parts]), kind="stable")

    def column(name: str) -> F64:
        gathered: F64 = np.concatenate([getattr(drive.drive, name)[part] for drive, part in parts])[order]
        return gathered

    leader: list[LeaderRecord | None] | None = None
    if any(drive.drive.ahead is not None for drive, _ in parts):
        unordered = [record for drive, part in parts for record in _leaders(drive.drive, part)]
        leader = [unordered[i] for i in order.tolist()]
    return Frame(
        entering=entering,
        t_us=np.concatenate([drive.t_us[part] for drive, part in parts])[order],
        row=np.concatenate([np.full(part.stop - part.start, drive.row) for drive, part in parts])[order],
        msg_cnt=np.concatenate([np.arange(part.start, part.stop) for _, part in parts])[order] & MSG_CNT_MASK,
        lat=column("lat"),
        lon=column("lon"),
        speed_mps=column("speed_mps"),
        heading_deg=column("heading_deg"),
        leader=leader,
    )


def _leaders(drive: Drive, part: slice) -> list[LeaderRecord | None]:
    ahead = drive.ahead
    if ahead is None:
        return [None] * (part.stop - part.start)
    return [
        None if which < 0 else (ahead.ids[which], range_m, range_rate_mps)
        for which, range_m, range_rate_mps in zip(
            ahead.which[part].tolist(), ahead.range_m[part].tolist(), ahead.range_rate_mps[part].tolist(), strict=True
        )
    ]


def span_s(frames: Iterable[Frame]) -> float:
    """Event time of the last message, by playing the frames through."""
    return max((int(frame.t_us[-1]) for frame in frames if len(frame)), default=0) / 1e6
