"""Frames of a running Bolo daemon, as numpy arrays in its own shared memory: nothing is copied.

    import bolo

    with bolo.Camera("front", timeout=5) as camera:
        for frame in camera:                       # every frame, in order, across restarts of the daemon
            hottest = frame.deblurred.max()        # uint16, height x width, read-only
            kelvin = frame.kelvin()                # float32, a new array
            points = camera.points([(320, 60)])    # kelvin, solved here, of the newest frame that can be
            moved = frame.motion                   # None, or by x bx x 3: px a frame and confidence of 8x8 blocks
            if not frame.valid():                  # the ring came round while we looked: throw the work away
                continue

One file; it needs numpy and libbolo-client.so.0 (BOLO_CLIENT_LIBRARY names another one). A camera is for one thread at
a time, but for close(): from another one it ends a wait, within a tenth of a second, with a ValueError. Arrays may go
anywhere, and keep the memory they lie in alive, even after the camera was closed. Times are seconds of time.monotonic()
where not said otherwise.
"""

from __future__ import annotations

import ctypes
import enum
import math
import os
import threading
import time
import weakref
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, fields
from functools import cached_property
from types import SimpleNamespace
from typing import Callable, Iterator, Optional, Sequence, Tuple

import numpy as np

__all__ = ["Camera", "Flag", "Frame", "Info", "State", "Error", "NotFound", "Denied", "Unavailable", "streams", "version"]

_SLICE_MS = 100  # of a wait: maximum delay of Ctrl-C and close()


class Flag(enum.IntFlag):
    """Flags of a frame (enum bolo_shm_flag)."""
    GAP = 1  # a frame of its window was lost
    WARM_UP = 2  # no full window yet: the deblurred plane is the raw one
    NUC = 4  # the camera was performing a NUC
    SATURATED = 8  # raw values at the end of the range
    JITTER = 16  # camera timestamp off the frame grid
    REDUCED = 32  # overload: a cheaper solver was used
    INVERSE = 64  # overload: inverse filter
    RAW = 128  # overload: not solved, the deblurred plane is the raw one


class Error(RuntimeError):
    """One line: what is wrong and what to do. `result`: enum bolo_client_result."""

    def __init__(self, result: int, text: str):
        super().__init__(text)
        self.result = result


class NotFound(Error):
    """No stream has this name."""


class Denied(Error):
    """This user may not read the stream."""


class Unavailable(Error):
    """Points of this frame cannot be solved now: it is not published yet, has no full window, or has left the ring."""


_OK, _TIMEOUT, _RESTARTED, _ENDED, _OVERWRITTEN, _NOT_YET, _WARM_UP = range(7)
_ERRORS = {-1: NotFound, -2: Denied}
_UNAVAILABLE = {
    _OVERWRITTEN: "the frame, or one of its window, has left the ring",
    _NOT_YET: "the frames of its look-ahead are not published",
    _WARM_UP: "the daemon had no full window for it",
}

_KINDS = {"u32": ctypes.c_uint32, "u64": ctypes.c_uint64, "i64": ctypes.c_int64, "double": ctypes.c_double}
_KINDS |= {"text": ctypes.c_char_p, "address": ctypes.c_void_p}
_KINDS |= {"u64x8": ctypes.c_uint64 * 8, "u64x16": ctypes.c_uint64 * 16}
_KINDS |= {"char16": ctypes.c_char * 16, "char112": ctypes.c_char * 112}


def _structure(members: str) -> type:
    """A structure of the C headers: types with the names of their members, in order."""
    rows = [row.split() for row in members.split(";")]
    fields = [(name, _KINDS[row[0]]) for row in rows for name in row[1:]]
    return type("Structure", (ctypes.Structure,), {"_fields_": fields})


_Settings = _structure(  # bolo_shm_settings
    "u32 bytes method flags levels iterations camera_offset; double kappa lambda_ noise_k; char16 isa"
)
_Camera = _structure(  # bolo_shm_camera
    "u64 bytes state; i64 since_ns; u64x8 lost; u64 reopened stalls outage_frames corrections;"
    "i64 correction_ns clock_offset_ns; double clock_drift_ppm clock_jitter_ns; u64 clock_jumps received_packets;"
    "u64 missing_packets resent_packets; double temperature_k; char112 control_socket; u64 ptp; i64 ptp_offset_ns"
)
_KINDS |= {"settings": ctypes.POINTER(_Settings), "camera": ctypes.POINTER(_Camera)}
_Info = _structure(  # bolo_client_info
    "u32 width height unit row_step; double scale offset frame_period_s tau_s;"
    "u32 window lookahead slot_count writer_pid; i64 start_ns; u64 restarts; text camera_model camera_serial solver;"
    "settings settings; text control_socket; double row_delay_s"
)
_Frame = _structure(  # bolo_client_frame
    "u64 number missed frame_id; i64 camera_ns host_ns receive_ns publish_ns; double noise_k;"
    "u32 flags width height utc_uncertainty_us; address raw deblurred slot motion motion_blocks;"
    "u32 motion_across motion_down; i64 utc_ns"
)
_State = _structure(  # bolo_client_state
    "u32 alive clock_synchronised; i64 heartbeat_age_ns; u64 published received restarts warm_up gap_frames;"
    "u64 lost_frames; u64x16 lost; camera camera; i64 clock_error_ns; u64 clock_steps"
)


def _load() -> SimpleNamespace:
    path = os.environ.get("BOLO_CLIENT_LIBRARY") or "libbolo-client.so.0"
    try:
        library = ctypes.CDLL(path)
    except OSError as error:
        raise ImportError(f"{path}: {error}; install the package libbolo-client, or set BOLO_CLIENT_LIBRARY") from error
    functions, handle, frame = {}, ctypes.c_void_p, ctypes.POINTER(_Frame)
    for name, result, arguments in (
        ("version", ctypes.c_char_p, []),
        ("streams", ctypes.c_int, [ctypes.c_char_p, ctypes.c_size_t]),
        ("open", ctypes.c_int, [ctypes.c_char_p, ctypes.c_int, ctypes.POINTER(handle)]),
        ("close", None, [handle]),
        ("error", ctypes.c_char_p, [handle]),
        ("get_info", ctypes.POINTER(_Info), [handle]),
        ("get_state", ctypes.POINTER(_State), [handle]),
        ("next", ctypes.c_int, [handle, ctypes.c_int, frame]),
        ("latest", ctypes.c_int, [handle, ctypes.c_int, frame]),
        ("valid", ctypes.c_int, [frame]),
        ("points", ctypes.c_int, [handle, ctypes.c_uint64, ctypes.c_void_p, ctypes.c_size_t, ctypes.c_void_p]),
        ("hold_new", handle, [handle]),
        ("hold_free", None, [handle]),
    ):
        function = functions[name] = getattr(library, "bolo_client_" + name)
        function.restype, function.argtypes = result, arguments
    return SimpleNamespace(**functions)


_client = _load()


def _error(result: int, handle=None) -> Error:
    return _ERRORS.get(result, Error)(result, _client.error(handle).decode())


def version() -> str:
    """The library's version."""
    return _client.version().decode()


def streams() -> list[str]:
    """Names of the existing streams, including those of dead daemons."""
    text, needed = b"", 1 << 16
    while len(text) < needed:
        text = ctypes.create_string_buffer(needed)
        needed = _client.streams(text, len(text))
        if needed < 0:
            raise _error(needed)
    return text.value.decode().split()


def _seconds(ns: int) -> float:
    return ns * 1e-9


@dataclass(frozen=True)
class Info:
    """Properties of a stream; bolo/client.h describes each field."""
    width: int
    height: int
    kelvin: bool  # kelvin = scale * value + offset; otherwise values are counts
    scale: float
    offset: float
    row_step: int
    row_delay_s: float  # sensor row r is sampled r * row_delay_s after the frame's time
    frame_period_s: float
    tau_s: float
    window: int
    lookahead: int
    slot_count: int
    writer_pid: int
    camera_model: str
    camera_serial: str
    solver: str
    control_socket: str
    lambda_: Optional[float]  # None: not published
    kappa: Optional[float]

    @staticmethod
    def _of(info: _Info) -> "Info":
        settings = info.settings.contents if info.settings else None
        values = {field.name: getattr(info, field.name, None) for field in fields(Info)}
        values |= {name: values[name].decode(errors="replace") for name in ("camera_model", "camera_serial", "solver")}
        values["control_socket"] = os.fsdecode(info.control_socket)
        values["kelvin"] = info.unit == 0
        values |= {name: getattr(settings, name, None) for name in ("lambda_", "kappa")}
        return Info(**values)


_CAMERA_STATES = ("idle", "streaming", "stalled", "lost", "correcting")
_PTP_STATES = ("initializing", "faulty", "disabled", "listening", "pre-master", "master", "passive", "uncalibrated", "slave")
_LOSS_CAUSES = ("incomplete", "missing", "pool_exhausted", "queue_full", "bad_frame", "driver", "out_of_order")


@dataclass(frozen=True)
class State:
    """State of daemon and camera at the time of the call."""
    alive: bool
    heartbeat_age_s: float
    published: int
    received: int
    restarts: int  # windows emptied
    warm_up: int
    gap_frames: int
    lost: dict[str, int]  # frames, by cause
    camera: Optional[str]  # "streaming", "lost" ...; None: not published
    reopened: int
    temperature_k: Optional[float]
    ptp: Optional[str]  # port state of the camera's PTP clock, "slave" ...; None: PTP is off or not published
    ptp_offset_s: Optional[float]  # from its PTP master, computed by the camera
    clock_synchronised: bool  # the host's clock is disciplined, according to its kernel
    clock_error_s: float  # maximum error of the host's UTC; 16: unknown
    clock_steps: int  # number of times the clock was set

    @staticmethod
    def _of(state: _State) -> "State":
        camera = state.camera.contents if state.camera else _Camera(state=len(_CAMERA_STATES))
        values = {field.name: getattr(state, field.name, None) for field in fields(State)}
        values["lost"] = dict(zip(_LOSS_CAUSES, state.lost))
        values["heartbeat_age_s"], values["clock_error_s"] = _seconds(state.heartbeat_age_ns), _seconds(state.clock_error_ns)
        values |= {name: bool(values[name]) for name in ("alive", "clock_synchronised")}
        values["camera"] = dict(enumerate(_CAMERA_STATES)).get(camera.state)
        values["reopened"] = camera.reopened
        values["temperature_k"] = camera.temperature_k if camera.temperature_k > 0 else None
        values["ptp"] = dict(enumerate(_PTP_STATES, 1)).get(camera.ptp)
        values["ptp_offset_s"] = _seconds(camera.ptp_offset_ns) if values["ptp"] else None
        return State(**values)


class _Ring:
    """Keeps a ring mapped while arrays refer to it."""

    def __init__(self, handle):
        hold = _client.hold_new(handle)
        if not hold:
            raise MemoryError("bolo: no memory to hold a ring")
        weakref.finalize(self, _client.hold_free, hold)

    def view(self, address: int, *shape: int, kind=ctypes.c_uint16) -> np.ndarray:
        words = (kind * int(np.prod(shape))).from_address(address)
        words.ring = self  # the array's base keeps the ring mapped
        return np.frombuffer(memoryview(words).toreadonly(), np.dtype(kind)).reshape(shape)


def _field(name: str, text: str, made: Callable = int, unknown: Optional[int] = None) -> property:
    """A field of a frame; None if it has the value `unknown`."""
    return property(lambda frame: None if (value := getattr(frame._lent, name)) == unknown else made(value), doc=text)


class Frame:
    """A frame in place in the ring: results computed from it count only if valid() is true afterwards."""

    def __init__(self, lent: _Frame, ring: _Ring, info: Info, restarted: bool):
        self._lent, self._ring = lent, ring
        self.info, self._own = info, False
        self.restarted = restarted  # first frame of another daemon: info may differ

    @cached_property
    def raw(self) -> np.ndarray:
        """uint16, height x width, as the camera sent it: a read-only view."""
        return self._ring.view(self._lent.raw, self.info.height, self.info.width)

    @cached_property
    def deblurred(self) -> np.ndarray:
        """uint16, height x width, deblurred: a read-only view."""
        return self._ring.view(self._lent.deblurred, self.info.height, self.info.width)

    @cached_property
    def motion(self) -> Optional[np.ndarray]:
        """float32, blocks down x blocks across x 3: how each block of 8x8 pixels moved from the frame before to this one,
        px a frame to the right and down, and the confidence of that, 0 to 1: a read-only view. None: it is not known for
        this frame, or the daemon's solver does not estimate it (solver "motion" does)."""
        lent = self._lent
        if not lent.motion_blocks:
            return None
        return self._ring.view(lent.motion_blocks, lent.motion_down, lent.motion_across, 3, kind=ctypes.c_float)

    @cached_property
    def affine(self) -> Optional[np.ndarray]:
        """float64, 2 x 3: the whole picture's motion, px a frame: affine @ (1, X, Y) at X columns and Y rows from the
        frame's centre: a read-only view. None where motion is."""
        return self._ring.view(self._lent.motion, 2, 3, kind=ctypes.c_double) if self._lent.motion else None

    def kelvin(self, plane: Optional[np.ndarray] = None) -> np.ndarray:
        """float32, height x width: of the deblurred plane, or of `plane`."""
        if not self.info.kelvin:
            raise ValueError("this stream is in counts, which nothing says how to make kelvin of")
        plane = self.deblurred if plane is None else plane
        return plane * np.float32(self.info.scale) + np.float32(self.info.offset)

    def valid(self) -> bool:
        """True if everything read from the planes so far was this frame's (not overwritten)."""
        return self._own or _client.valid(self._lent) == 1

    def copy(self) -> Optional["Frame"]:
        """A copy with planes of its own, always valid; None if the frame was overwritten."""
        other = Frame(self._lent, self._ring, self.info, self.restarted)
        for name in ("raw", "deblurred", "motion", "affine"):
            values = getattr(self, name)
            setattr(other, name, None if values is None else values.copy())
        other._own = self.valid()
        return other if other._own else None

    number = _field("number", "Publication order of its daemon, from 0.")
    missed = _field("missed", "Frames published between this and the one given before it that were not given.")
    frame_id = _field("frame_id", "The camera's counter.")
    flags = _field("flags", "What is special about it.", Flag)
    camera_time = _field("camera_ns", "When it was taken, s of the camera's clock.", _seconds)
    host_time = _field("host_ns", "When it was taken; None: not known.", _seconds, 0)
    receive_time = _field("receive_ns", "When its first byte came in.", _seconds)
    publish_time = _field("publish_ns", "When it was put into the ring.", _seconds)
    utc_ns = _field("utc_ns", "When it was taken, ns since 1970 by host_time, or else receive_time; None: not known.", int, 0)
    utc = _field("utc_ns", "The same in seconds, as time.time() has them; a float holds them to 0.2 us.", _seconds, 0)
    utc_uncertainty = _field("utc_uncertainty_us", "How wrong utc is at most, s; 16 and more: no bound.", lambda us: us * 1e-6)


class Camera(AbstractContextManager):
    """A daemon's stream, followed across its restarts. Iterate, or call next() and latest()."""

    def __init__(self, name: str, timeout: Optional[float] = 0.0, follow: bool = True):
        """Opens the stream of the daemon with [shm] name = `name`, waiting up to `timeout` seconds for it (None: as long
        as it takes). follow=False: iteration ends with the daemon, instead of waiting for the next one."""
        self.name, self.follow = name, follow
        self._handle = ctypes.c_void_p()
        self._lock = threading.RLock()  # held while the library uses the handle
        self._users = 0  # of the handle: one, plus an interrupting signal handler
        self._closed = self._restarted = False
        end = _end(timeout)
        encoded = os.fsencode(name).replace(b"\0", b"/")  # names contain neither; C would stop at the first NUL
        while (result := _client.open(encoded, _slice_ms(end), ctypes.byref(self._handle))) != _OK:
            if result not in (-1, -2, -3) or time.monotonic() >= end:
                raise _error(result)
        self._close = weakref.finalize(self, _client.close, self._handle)
        self._close.atexit = False  # the process's end frees everything; another thread may still wait
        self._refresh()

    def _refresh(self) -> None:
        info = _client.get_info(self._handle).contents
        self.info, self.restarts = Info._of(info), info.restarts  # restarts followed
        self._ring = _Ring(self._handle)

    def __exit__(self, *_) -> None:
        self.close()

    def __reduce__(self):
        raise TypeError(f"the camera '{self.name}' cannot be copied or pickled: open it once more")  # one handle, one close

    def close(self) -> None:
        """Ends waiting calls. Frames and arrays returned before remain usable. Any thread."""
        self._closed = True  # before the lock: a wait releases it between slices, and checks
        with self._lock:
            if self._users == 0:
                self._close()

    @contextmanager
    def _open_handle(self):
        """The handle, held so that no other thread uses or frees it."""
        with self._lock:
            self._users += 1
            try:
                if self._closed:
                    raise ValueError(f"the camera '{self.name}' is closed")
                yield self._handle
            finally:
                self._users -= 1
                if self._closed and self._users == 0:
                    self._close()

    def __iter__(self) -> Iterator[Frame]:
        """Every frame in order, waiting for each as long as it takes."""
        return iter(self.next, None)

    def next(self, timeout: Optional[float] = None) -> Optional[Frame]:
        """The next frame in order; None when none came within `timeout` seconds (None: as long as it takes), or when the
        daemon ended and is not to be followed. Frames overwritten before it are counted in frame.missed."""
        return self._wait("next", timeout)

    def latest(self, timeout: Optional[float] = None) -> Optional[Frame]:
        """The newest frame not returned before; skipped ones count as missed."""
        return self._wait("latest", timeout)

    def _wait(self, function: str, timeout: Optional[float]) -> Optional[Frame]:
        end = _end(timeout)
        while True:
            lent = _Frame()
            with self._open_handle() as handle:
                result = getattr(_client, function)(handle, _slice_ms(end), lent)
                if result < 0:
                    raise _error(result, handle)
                self._restarted |= result == _RESTARTED
                if result == _RESTARTED or self.info.frame_period_s != _client.get_info(handle).contents.frame_period_s:
                    self._refresh()
            if result == _OK:
                restarted, self._restarted = self._restarted, False
                return Frame(lent, self._ring, self.info, restarted)
            if (result in (_ENDED, _RESTARTED) and not self.follow) or time.monotonic() >= end:
                return None

    def points(self, points: Sequence[Tuple[int, int]], frame: Optional[Frame] = None) -> np.ndarray:
        """float32: kelvin (else counts) at each (x, y) of `frame`, or of the newest that can be solved, from its window's
        raw planes, here: the deblurred plane's bits. Raises Unavailable when the ring does not hold the window."""
        number = self.state().published - 1 - self.info.lookahead if frame is None else frame.number
        if number < 0:
            raise Unavailable(_NOT_YET, "no frame is published that could be solved")
        asked = np.ascontiguousarray(points)
        if asked.size == 0:
            return np.empty(0, np.float32)
        if asked.ndim != 2 or asked.shape[1] != 2 or not ((asked >= 0) & (asked < 1 << 31) & (asked % 1 == 0)).all():
            raise ValueError("points: expected pairs (x, y) of pixels inside the frame")
        asked = np.ascontiguousarray(asked, dtype=np.uint32)
        values = np.empty(len(asked), np.float32)
        with self._open_handle() as handle:
            result = _client.points(handle, number, asked.ctypes.data, len(asked), values.ctypes.data)
            if result < 0:
                raise _error(result, handle)
        if result != _OK:
            raise Unavailable(result, f"no points of frame {number}: {_UNAVAILABLE[result]}")
        return values

    def state(self) -> State:
        """The present state of daemon and camera."""
        with self._open_handle() as handle:
            return State._of(_client.get_state(handle).contents)


def _end(timeout: Optional[float]) -> float:
    return math.inf if timeout is None else time.monotonic() + timeout


def _slice_ms(end: float) -> int:
    return max(0, round(min(_SLICE_MS, (end - time.monotonic()) * 1000)))
