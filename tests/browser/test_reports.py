"""Pages in headless Chromium (`make test-browser`): reports without console messages or network access, with pictures,
the path and a playing video; the documentation, opened as a file and searched."""

import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from urllib.parse import unquote_to_bytes

import cv2
import pytest
from results import ODD_NAMES, write_results

from pps_vision.app.batch import TRACK_TABLE
from pps_vision.app.cli import main
from pps_vision.app.report.tracking import report_folder
from pps_vision.recordings.tables import write_table

pytestmark = pytest.mark.skipif("PPS_VISION_BROWSER" not in os.environ, reason="only with make test-browser")
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--enable-logging=stderr")
OFFLINE = "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"
PLAYS_S = 3.0


def browse(page: Path, *words: str, query: str = "") -> subprocess.CompletedProcess[str]:
    profile = f"--user-data-dir={page.parent / 'profile'}"
    command = [os.environ["PPS_VISION_BROWSER"], *FLAGS, OFFLINE, profile, *words, page.resolve().as_uri() + query]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)


def add_script(page: Path, check: str) -> None:
    """Add HTML with a script, which the page's policy must allow."""
    text = re.sub("script-src '[^']*'", "script-src 'unsafe-inline'", page.read_text().replace("&#39;", "'"))
    page.write_text(text.replace("img-src data:", "img-src data: http:").replace("</html>", check + "</html>"))


def test_the_page_of_a_recording(tmp_path):
    folder = write_results(tmp_path / "results")
    report_folder(folder)
    page = folder / "report.html"
    check = (
        "<script>window.addEventListener('load',()=>{const c=document.querySelector('canvas');"
        "const d=c.getContext('2d').getImageData(0,0,c.width,c.height).data;let n=0;"
        "for(let k=0;k<d.length;k+=4)if(d[k+3]>0&&d[k+1]>d[k]+60)n++;"
        "const bad=[...document.images].filter(i=>!i.naturalWidth).length;"
        "document.title=`green ${n} broken ${bad} of ${document.images.length}`;});</script>"
    )
    add_script(page, check)
    page_load = browse(page, "--dump-dom")
    green, broken, images = map(int, re.findall(r"green (\d+) broken (\d+) of (\d+)", page_load.stdout)[0])
    assert green > 300  # pixels of the path
    assert (broken, images) == (0, 5)
    assert "CONSOLE" not in page_load.stderr
    browse(page, f"--screenshot={tmp_path / 'page.png'}", "--window-size=1100,4200")
    assert cv2.imread(str(tmp_path / "page.png")).std() > 10


@pytest.fixture
def keeps_loading() -> Iterator[str]:
    """Address of an image that takes three seconds: until then a page is not loaded, and a video in it plays."""

    class Slow(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            time.sleep(PLAYS_S)
            self.send_response(204)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    with ThreadingHTTPServer(("127.0.0.1", 0), Slow) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


def test_the_page_of_the_demo(tmp_path, keeps_loading):
    main(["demo", "--trials", "3", "--out", str(tmp_path / "demo")])
    page = tmp_path / "demo" / "report.html"
    check = (
        f"<img id=slow src={keeps_loading}><script>window.addEventListener('load',()=>{{"
        "const v=document.querySelector('video');"
        "const bad=[...document.images].filter(i=>i.id!='slow'&&!i.naturalWidth).length;"
        "const fetched=performance.getEntriesByType('resource').map(e=>e.name).join(' ');"
        "document.title=`at ${v.currentTime} of ${v.duration} width ${v.videoWidth} ${v.error} broken ${bad}"
        " of ${document.images.length} fetched ${fetched} end`;});</script>"
    )
    add_script(page, check)
    page_load = browse(page, "--dump-dom")
    pattern = r"at (\S+) of (\S+) width (\d+) null broken (\d+) of (\d+) fetched (.*?) end"
    at_s, length_s, width, broken, images, fetched = re.findall(pattern, page_load.stdout)[0]
    assert 0.5 < float(at_s) <= float(length_s)
    assert float(length_s) > 5
    assert (int(width), int(broken)) == (1280, 0)
    assert int(images) == 1 + 3  # episodes, landscapes, coordinates
    assert fetched == keeps_loading
    assert "CONSOLE" not in page_load.stderr


def test_no_other_script_runs(tmp_path):
    folder = write_results(tmp_path / "results")
    report_folder(folder)
    page = folder / "report.html"
    page.write_text(page.read_text().replace("</html>", "<script>document.title='ran'</script></html>"))
    page_load = browse(page, "--dump-dom")
    assert "<title>ran</title>" not in page_load.stdout
    assert "violates the following Content Security Policy directive" in page_load.stderr


def test_the_page_of_a_batch(tmp_path):
    for name in ODD_NAMES:
        write_results(tmp_path / name)
    rows = [(name, "done", 40, 40, 0.925, "", 1.5, "0.2.0", "") for name in ODD_NAMES]
    write_table(tmp_path / "batch.csv", list(TRACK_TABLE), [*rows, ("c", "failed", *[""] * 6, "cannot be read")])
    report_folder(tmp_path)
    page = tmp_path / "report.html"
    check = (
        "<script>window.addEventListener('load',()=>{const of=[...document.links].map(a=>a.href).join(' ');"
        "const bad=[...document.images].filter(i=>!i.naturalWidth).length;"
        "const fetched=performance.getEntriesByType('resource').length;"
        "document.title=`${of} broken ${bad} of ${document.images.length} fetched ${fetched}`;});</script>"
    )
    add_script(page, check)
    page_load = browse(page, "--dump-dom")
    *links, _, broken, _, images, _, fetched = re.search("<title>(.*?)</title>", page_load.stdout)[1].split(" ")
    assert (broken, images, fetched) == ("0", "1", "0")
    files = [Path(os.fsdecode(unquote_to_bytes(link.removeprefix("file://")))) for link in links]
    assert files == [tmp_path / name / "report.html" for name in ODD_NAMES]
    assert all(file.is_file() for file in files)
    assert "CONSOLE" not in page_load.stderr


def test_the_documentation_is_searched_from_a_file(tmp_path):
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")]
    subprocess.run(build, cwd=Path(__file__).parents[2], check=True)
    page_load = browse(
        tmp_path / "site" / "howto" / "camera.html", "--virtual-time-budget=5000", "--dump-dom", query="?q=chessboard"
    )
    assert "../quickstart.html" in re.findall(r'<article><h3><a href="([^"#]+)', page_load.stdout)
    assert "CONSOLE" not in page_load.stderr
