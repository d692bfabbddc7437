#!/usr/bin/env python3
"""Shows a stream in a window, hot is bright; without OpenCV it prints temperatures instead.

usage: opencv_view.py NAME [FRAMES]     (q or Esc ends it)
"""

import sys
import time

import bolo

try:
    import cv2
except ImportError:
    cv2 = None
    print("opencv_view: cv2 is missing (apt install python3-opencv); printing temperatures instead", file=sys.stderr)


def picture(plane):
    """8 bits a pixel: the plane's own range, in false colours."""
    grey = cv2.normalize(plane, None, 0, 255, cv2.NORM_MINMAX, cv2.CV_8U)
    return cv2.applyColorMap(grey, cv2.COLORMAP_INFERNO)


def show(name, frame):
    """False when the user wants no more."""
    shown = picture(frame.deblurred)  # OpenCV reads the shared memory itself
    if not frame.valid():  # overwritten while we read it
        return True
    cv2.imshow(name, shown)
    return cv2.waitKey(1) & 0xFF not in (ord("q"), 27)


class Printer:
    def __init__(self):
        self.next_time = 0.0

    def __call__(self, _, frame):
        if time.monotonic() < self.next_time:
            return True
        low, high = int(frame.deblurred.min()), int(frame.deblurred.max())
        if not frame.valid():
            return True
        info = frame.info
        unit = "K" if info.kelvin else "counts"
        low, high = (value * info.scale + info.offset if info.kelvin else value for value in (low, high))
        print(f"frame {frame.number}: {low:.2f} to {high:.2f} {unit}", flush=True)
        self.next_time = time.monotonic() + 0.2
        return True


def main(name, frames=None):
    use = show if cv2 else Printer()
    try:
        with bolo.Camera(name, timeout=5) as camera:
            while frames is None or frames > 0:
                frame = camera.latest()  # what the screen can't show is skipped
                if frame is None or not use(name, frame):
                    return 0
                frames = None if frames is None else frames - 1
    except bolo.Error as error:
        print(f"opencv_view: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        pass
    return 0


if __name__ == "__main__":
    if len(sys.argv) < 2:
        print(__doc__, file=sys.stderr)
        sys.exit(2)
    sys.exit(main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else None))
