"""The live page in a browser, with a daemon on the fake camera: contents, and targets of requests.

usage: view_test.py BOLO BOLOD [FOLDER]. Screenshots go to FOLDER, if given. BOLO_VIEW_FORMAT: width,height,rate of the
camera. Exit code 77: chromium or chromedriver isn't there.
"""

import array
import glob
import json
import os
import re
import signal
import struct
import subprocess
import sys
import tempfile
import time
import urllib.parse
import urllib.request
import zlib

import browser
from programs import Programs, wait_for

if browser.missing():
    print(f"skipped: {browser.missing()} is not installed")
    sys.exit(77)

WIDTH, HEIGHT, RATE = (int(v) for v in os.environ.get("BOLO_VIEW_FORMAT", "160,48,100").split(","))
PATIENCE_S = 60  # a guard against hanging, not an expectation
HEAD = struct.Struct("<4sHHIIddQQQqdIIIIq")  # FrameHead of tools/view/live_stream.hpp


class View(Programs):
    def __init__(self, bolo, bolod, folder, name):
        super().__init__(bolo, bolod, folder, name, (WIDTH, HEIGHT), f"rate_hz = {RATE}\n")

    def begin(self):
        self.capture = self.simulate(f"--rate={RATE}", f"--frames={RATE}", f"--speed={WIDTH / 2}")
        self.start_camera(self.capture, "--fault", "loss:rate=0.002,at=5")
        self.start_daemon()
        self.entry = self.view("view", self.name)["url"]  # with this run's token
        self.url, self.token = re.fullmatch(r"(.*/)\?token=([0-9a-f]{32})", self.entry).groups()

    def view(self, what, *words):
        """Status line of another view."""
        self.start(what, self.bolo, "view", *words, "--port", "0", "--json")
        return json.loads(wait_for(lambda: re.search(r'{"url".*}', self.log(what)), "the view").group())

    def get(self, path):
        port = urllib.parse.urlsplit(self.url).port
        request = urllib.request.Request(urllib.parse.urljoin(self.url, path),
                                         headers={"Cookie": f"bolo_view_{port}={self.token}"})
        with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
            return answer.read()


def figure(page, selector):
    words = page.run("return document.querySelector(arguments[0])?.firstChild.textContent ?? ''", selector)
    return int(re.sub(r"\D", "", words) or 0)


def attribute(page, name, key):
    return page.run("return document.getElementById(arguments[0]).getAttribute(arguments[1])", name, key)


def wait_for_pill(page, words, what):
    wait_for(lambda: page.text("#pill") == words, what)


def box_of(page, name):
    return page.run("const b = document.getElementById(arguments[0]).getBoundingClientRect();"
                    "return [b.x, b.y, b.width, b.height]", name)


def picture_hash(page):
    """Hash of the picture once everything requested is painted."""
    return page.run("""
        const frame = () => new Promise(requestAnimationFrame);
        return frame().then(frame).then(() => {
          const canvas = document.getElementById("picture");
          const {data} = canvas.getContext("2d").getImageData(0, 30, canvas.width, canvas.height - 30);
          return data.reduce((sum, value) => (sum * 31 + value) % 2147483647, 0);
        });""")


def check_frames_move(page):
    before = (picture_hash(page), figure(page, "#frame-id"))
    wait_for(lambda: picture_hash(page) != before[0] and figure(page, "#frame-id") > before[1], "another frame")


def check_divider(page):
    x, y, width, _ = box_of(page, "divider")
    box = (x + width / 2, y + 20)
    width = page.run("return document.getElementById('picture').clientWidth")
    now = lambda: int(attribute(page, "divider", "aria-valuenow"))
    page.mouse(box, "down", (box[0] + width / 4, box[1]), "up")
    wait_for(lambda: 74 <= now() <= 76, "the divider by the mouse")
    page.run("document.getElementById('divider').focus()")
    page.keys("\ue012", "\ue012")  # left
    assert 72 <= now() <= 74, now()
    # With a held frame: in the view of all planes, one plane equals the view of that plane alone.
    page.keys(" ")
    shown = {}
    for key, mode in (("\ue012", "sharp"), ("\ue014", "raw")):
        page.click(f'#modes [data-value="{mode}"]')
        shown[mode] = picture_hash(page)
        page.click('#modes [data-value="divider"]')
        page.run("document.getElementById('divider').focus()")
        page.keys(*(key,) * 101)
        wait_for(lambda: picture_hash(page) == shown[mode], f"all of {mode} by the divider")
    assert shown["raw"] != shown["sharp"], "deblurring changed nothing"
    page.keys(*("[",) * 25)
    page.click("#pause")


def check_trace(page, programs):
    box = box_of(page, "picture")
    page.mouse((box[0] + box[2] * 0.25, box[1] + box[3] * 0.5), "down", "up")
    title = wait_for(lambda: re.search(r"Pixel (\d+), (\d+)", page.text("#trace-title")), "the pixel")
    x, y = int(title.group(1)), int(title.group(2))
    assert abs(x - WIDTH / 4) <= 1, (x, y)
    wait_for(lambda: "°C" in page.text("#trace-sharp"), "a value of the pixel")
    follow = f"/api/trace?x={x}&y={y}&epoch=0&after=0"
    programs.get(follow)
    body = programs.get("/api/frame?epoch=0&after=0")
    head = HEAD.unpack_from(body)
    planes = array.array("H", body[HEAD.size:])
    at = y * WIDTH + x
    wanted = (planes[at], planes[WIDTH * HEIGHT + at])
    later = lambda: (t := json.loads(programs.get(follow)))["t_s"][-1] > head[10] * 1e-9 + 0.1 and t
    trace = wait_for(later, "samples")
    times = trace["t_s"]
    nearest = min(range(len(times)), key=lambda i: abs(times[i] - head[10] * 1e-9))
    assert abs(times[nearest] - head[10] * 1e-9) < 1e-4
    assert (trace["raw"][nearest], trace["deblurred"][nearest]) == wanted
    steps = [b - a for a, b in zip(times, times[1:])]
    frames = [round(step * RATE) for step in steps]  # several if the daemon lost some
    assert all(n >= 1 and abs(step - n / RATE) < 1e-4 for n, step in zip(frames, steps)), steps
    return sum(n == 1 for n in frames), len(steps)


def check_choices(page):
    def value(element):
        return page.run(f"return document.getElementById('{element}').value")

    page.click('#ranges [data-value="fixed"]')
    page.run("const i = document.getElementById('low'); i.value = '-5'; i.dispatchEvent(new Event('change'))")
    wait_for(lambda: attribute(page, "low-thumb", "aria-valuenow") == "-5.0", "-5 °C")
    page.click("#unit")
    wait_for(lambda: value("low") == "268.1", "kelvin")
    page.click("#unit")
    page.click('#ranges [data-value="auto"]')
    page.click("#zoom-in")
    wait_for(lambda: page.text("#zoom-fit") == "150 %", "zoom")
    page.click("#zoom-fit")
    page.keys("?")
    wait_for(lambda: page.run("return document.getElementById('help').open"), "the keys")
    page.keys("\ue00c")  # escape


def check_nuc(page):
    before = figure(page, "#nucs")
    page.click("#nuc")
    wait_for(lambda: figure(page, "#nucs") > before, "a correction")


def check_faults_are_counted(page):
    before = wait_for(lambda: figure(page, "#lost-incomplete dd"), "a lost frame")
    wait_for(lambda: figure(page, "#lost-incomplete dd") > before, "another lost frame")


def grey_png(file):
    """Pixel rows of a 16-bit PNG without row filters."""
    with open(file, "rb") as f:
        data = f.read()
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, chunks = 8, {}
    while at < len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        chunks[kind] = data[at + 8:at + 8 + length]
        assert zlib.crc32(data[at + 4:at + 8 + length]) == struct.unpack_from(">I", data, at + 8 + length)[0]
        at += 12 + length
    width, height, depth, colour = struct.unpack_from(">IIBB", chunks[b"IHDR"])
    assert (depth, colour) == (16, 0)
    rows = zlib.decompress(chunks[b"IDAT"])
    return [struct.unpack_from(f">{width}H", rows, y * (1 + 2 * width) + 1) for y in range(height)]


def check_saving(page, folder):
    def saved(what, pattern):
        page.run("document.getElementById('save').open = true")
        page.click(f'[data-save="{what}"]')
        # The browser first creates an empty file of that name.
        return wait_for(lambda: [f for f in glob.glob(os.path.join(folder, pattern)) if os.path.getsize(f) > 0], pattern)[0]

    page.keys("\ue00c")
    page.click("#pause")
    values = grey_png(saved("sharp16", "*-sharp-16bit.png"))
    assert (len(values[0]), len(values)) == (WIDTH, HEIGHT)
    with open(saved("sharpcsv", "*-sharp-kelvin.csv"), encoding="ascii") as f:
        kelvin = [[float(v) for v in line.split(",")] for line in f]
    assert all(abs(k - 0.01 * v) < 6e-4 for a, b in zip(kelvin, values) for k, v in zip(a, b))
    saved("picture", "*-divider.png")
    page.click("#pause")


def check_restart(page, programs):
    """When the daemon dies, the page reports it, and continues with the next one."""
    programs.kill("daemon")
    wait_for_pill(page, "the daemon is gone", "the words of its end")
    assert page.run("return !document.getElementById('notice').hidden")
    programs.start_daemon()
    wait_for_pill(page, "live", "the next daemon's frames")
    check_frames_move(page)
    wait_for(lambda: figure(page, "#followed") == 1, "the restart")


def check_motion(page, programs, folder):
    """Arrows on a key: none for a solver without motion, shown for one with motion."""

    def pictures():
        """Hashes of a held frame's picture without, with and without arrows, and the page's text."""
        page.click("#pause")  # space would press the focused button
        hashes = [picture_hash(page)]
        for arrows in ("true", "false"):
            page.keys("m")
            wait_for(lambda: attribute(page, "arrows", "aria-pressed") == arrows, "the button")
            hashes.append(picture_hash(page))
            if arrows == "true":
                words = page.text("#toast")
        page.click("#pause")
        return *hashes, words

    def drawn():
        """Whether arrows are shown, and the page's text; retried because the layout may change in between."""
        before, shown, _, words = wait_for(lambda: (seen := pictures())[0] == seen[2] and seen, "it without arrows")
        return shown != before, words

    any_drawn, words = drawn()
    assert not any_drawn and "solver = \"motion\"" in words, words
    assert page.text("#motion") == "–"
    programs.kill("daemon", signal.SIGTERM)
    with open(programs.config, "a", encoding="utf-8") as f:
        # On a busy machine, degraded frames would have no motion.
        f.write('[deblur]\nsolver = "motion"\n[pipeline]\ndegrade = false\n')
    programs.start_daemon()
    # px per frame, of a street that moves by half a width per second
    wait_for(lambda: (m := re.match(r"([0-9.]+) a frame", page.text("#motion"))) and
             abs(float(m.group(1)) - WIDTH / 2 / RATE) < 0.3, "the street's motion")
    wait_for(lambda: drawn()[0], "arrows")
    if folder:
        page.keys("m")
        for mode in ("sharp", "divider"):
            page.size(1366, 900)
            page.click(f'#modes [data-value="{mode}"]')
            time.sleep(1)
            page.screenshot(os.path.join(folder, f"view_motion_{mode}.png"))
        page.keys("m")


def check_hurry(page):
    """Frames below full quality are reported until full quality is back."""
    shown = lambda: page.run("return !document.getElementById('effort').hidden")
    page.run("""const fetched = window.fetch;
        window.fetch = async (path, ...more) => {
          const answer = await fetched(path, ...more);
          if (!path.startsWith("api/frame") || answer.status !== 200 || window.solved) return answer;
          const buffer = await answer.arrayBuffer();
          new DataView(buffer).setUint32(72, 64, true);  // inverse, and nothing else
          return new Response(buffer);
        };""")
    wait_for(lambda: page.text("#effort") == "100 % not fully solved", "the words on frames in a hurry")
    assert shown() and "100 % by the inverse filter" in page.run("return document.getElementById('effort').title")
    page.run("window.solved = true")
    wait_for(lambda: not page.text("#effort").startswith("100"), "the end of the hurry")


def check_phone(page):
    """Nothing is cut off or outside the window, however narrow it is."""
    for width in (390, 360, 320):
        page.size(width, 800, 2, True)
        cut = page.run("""return [...document.querySelectorAll("header *, main *")].filter((e) => !e.children.length &&
            !e.matches(".hidden, canvas, option, .thumb") && e.clientWidth > 0 && e.scrollWidth > e.clientWidth + 1)
            .map((e) => e.textContent);""")
        assert not cut, (width, cut)
        assert page.run("return document.documentElement.scrollWidth") <= width
    page.size(1366, 900)


def check_token(page, programs):
    """A token opens the page once; then the browser keeps a cookie, and the address no longer has the token."""
    token = "e2e-0123456789abcdef"
    url = programs.view("token", programs.name, "--token", token)["url"].removesuffix("?token=TOKEN")
    assert token not in programs.log("token"), "a token that was given is printed"
    page.open(url)
    assert "a token is needed" in page.run("return document.body.textContent")
    page.open(f"{url}?token={token}")
    wait_for_pill(page, "live", "the page by its token")
    assert page.run("return location.href") == url
    page.open(url)
    wait_for_pill(page, "live", "the page by its cookie")
    page.log("browser")  # the refusal


def check_several(page, programs, folder):
    """Two cameras: side by side with live pictures and times, and each on its own page."""
    other = programs.name + "-rear"
    programs.start("replay", programs.bolo, "replay", programs.capture, "--name", other, "--loop")
    told = programs.view("several", programs.name, other)
    assert told["name"] == f"{programs.name}, {other}", told
    page.open(told["url"])
    canvas = "document.querySelectorAll('.camera canvas')[arguments[0]]"
    # An empty canvas is 300 pixels wide.
    picture = f"return {canvas} && {canvas}.width === 300 ? '' : {canvas}?.toDataURL() ?? ''"
    for i in range(2):
        first = wait_for(lambda: page.run(picture, i), "a picture")
        wait_for(lambda: page.run(picture, i) != first, "another picture")
        wait_for(lambda: re.fullmatch(r"\d\d:\d\d:\d\d\.\d{3}", page.run(
            "return document.querySelectorAll('.camera span')[arguments[0]].textContent", i)), "its time")
    if folder:
        page.screenshot(os.path.join(folder, "view_all.png"))
    page.run("document.querySelectorAll('.camera')[1].click()")
    wait_for_pill(page, "live", "the page of one")
    wait_for(lambda: page.text("#name") == other, "its name")
    check_frames_move(page)
    page.log("browser")


def check_usage(programs):
    """`bolo view` refuses to start: exit code 2 and one line with the remedy."""
    port = str(urllib.parse.urlsplit(programs.url).port)
    for words, told in ((["--listen", "0.0.0.0"], "--token"), (["--port", port], "another program"),
                        (["--token", "short"], "16 to 128"), (["--token-file", "/nowhere"], "/nowhere"),
                        (["--listen", "localhost", "--token", "0123456789abcdef"], "an IP address"), (["--port", "70000"], "70000")):
        done = subprocess.run([programs.bolo, "view", programs.name, *words], capture_output=True, text=True,
                              timeout=PATIENCE_S, check=False)
        assert done.returncode == 2 and done.stderr.count("\n") == 1 and told in done.stderr, (words, done)


def take_pictures(page, folder):
    wait_for(lambda: page.run("return getComputedStyle(document.getElementById('toast')).opacity") == "0", "quiet")
    for scheme, mode in (("light", "both"), ("dark", "divider")):
        page.size(1280, 960)
        page.scheme(scheme)
        page.click(f'#modes [data-value="{mode}"]')
        time.sleep(2.5)  # the full length of a trace
        page.screenshot(os.path.join(folder, f"view_{scheme}.png"))
    page.size(390, 844, 2, True)
    page.run("scrollTo(0, 0)")
    page.click('#modes [data-value="both"]')
    time.sleep(1)
    page.screenshot(os.path.join(folder, "view_phone.png"))
    page.size(1366, 900)
    page.click('#modes [data-value="divider"]')


def check_requests(page):
    """Targets of the page's requests, and its files' sizes."""
    weight, kinds = 0, {}
    for entry in page.log("performance"):
        event = json.loads(entry["message"])["message"]
        told = event["params"]
        if event["method"] == "Network.requestWillBeSent":
            url = urllib.parse.urlsplit(told["request"]["url"])
            if url.scheme in ("blob", "data"):
                continue
            assert url.scheme == "http" and url.hostname == "localhost", told["request"]["url"]
            kinds[told["requestId"]] = url.path
        if event["method"] == "Network.loadingFinished" and not kinds.get(told["requestId"], "/api").startswith("/api"):
            weight += told["encodedDataLength"]
    # Rendering warnings are expected: this test reads canvases back.
    bad = [entry["message"] for entry in page.log("browser") if not entry["message"].startswith("rendering ")]
    assert not bad, bad
    return weight


def main(bolo, bolod, pictures):
    with tempfile.TemporaryDirectory() as folder:
        programs = View(bolo, bolod, folder, "front" if pictures else f"test-view-{os.getpid()}")
        page = None
        try:
            programs.begin()
            page = browser.Browser(folder)
            page.open("about:blank")
            page.log("performance")  # the browser's initial page
            page.open(programs.entry)
            wait_for_pill(page, "live", "the page")

            weight = check_requests(page)
            check_frames_move(page)
            check_divider(page)
            traced = check_trace(page, programs)
            check_choices(page)
            check_nuc(page)
            check_saving(page, folder)
            check_faults_are_counted(page)
            if pictures:
                time.sleep(3)  # without a pause, for measurement
            shown = page.text("#shown")
            check_restart(page, programs)
            check_phone(page)
            check_hurry(page)
            if pictures:
                take_pictures(page, pictures)
            check_motion(page, programs, pictures)
            check_requests(page)
            check_token(page, programs)
            check_several(page, programs, pictures)
            check_usage(programs)
            programs.running["view"].send_signal(signal.SIGTERM)
            assert programs.running["view"].wait() == 0
        except BaseException:
            sys.stderr.write(programs.logs())
            if page:
                page.screenshot(os.path.join(tempfile.gettempdir(), "view_failed.png"))
            raise
        finally:
            if page:
                page.close()
            programs.end()
    print(f"page {weight / 1024:.0f} KiB; {shown} frames/s shown of {WIDTH}x{HEIGHT} at {RATE} Hz; "
          f"trace: {traced[0]} of {traced[1]} steps one frame long")


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], sys.argv[3] if len(sys.argv) > 3 else None)
