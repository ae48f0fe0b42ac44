"""Pages in a headless Chromium (`make test-browser`): reports with nothing in the console, pictures there and the path
drawn; the documentation, opened as a file and searched."""

import os
import re
import subprocess
import sys
from pathlib import Path

import cv2
import pytest
from results import write_results

from pps_vision.app.report.tracking import report_folder

pytestmark = pytest.mark.skipif("PPS_VISION_BROWSER" not in os.environ, reason="only with make test-browser")
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--enable-logging=stderr")
OFFLINE = "--host-resolver-rules=MAP * ~NOTFOUND"


def browse(page: Path, *words: str, query: str = "") -> subprocess.CompletedProcess[str]:
    profile = f"--user-data-dir={page.parent / 'profile'}"
    command = [os.environ["PPS_VISION_BROWSER"], *FLAGS, OFFLINE, profile, *words, page.resolve().as_uri() + query]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)


def test_the_page_of_a_recording(tmp_path: Path) -> None:
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
    page.write_text(page.read_text().replace("</html>", check + "</html>"))
    seen = browse(page, "--dump-dom")
    green, broken, images = map(int, re.findall(r"green (\d+) broken (\d+) of (\d+)", seen.stdout)[0])
    assert green > 300  # pixels of the path
    assert (broken, images) == (0, 5)
    assert "CONSOLE" not in seen.stderr
    browse(page, f"--screenshot={tmp_path / 'page.png'}", "--window-size=1100,4200")
    assert cv2.imread(str(tmp_path / "page.png")).std() > 10


def test_the_documentation_is_searched_from_a_file(tmp_path: Path) -> None:
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(tmp_path / "site")]
    subprocess.run(build, cwd=Path(__file__).parents[2], check=True)
    seen = browse(
        tmp_path / "site" / "howto" / "camera.html", "--virtual-time-budget=5000", "--dump-dom", query="?q=chessboard"
    )
    found = re.findall(r'<article><h3><a href="([^"#]+)', seen.stdout)
    assert "../quickstart.html" in found
    assert "CONSOLE" not in seen.stderr
