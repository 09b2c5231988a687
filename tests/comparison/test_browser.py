"""The report in a browser: nothing is cut at any width, and its script does what it should."""

import json
import re
import shutil
import subprocess
from html import unescape

import pytest

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")

pytestmark = [
    pytest.mark.release,
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium"),
]

WIDTHS = (390, 1200, 1920)

# A page around the report, which looks into it as a reader would: the report allows no foreign
# script within itself.
AROUND = """<!doctype html><body><script>
const found = {widths: {}};
function look(width) {
  const frame = document.createElement("iframe");
  frame.style = `border:0;width:${width}px;height:900px`;
  frame.src = "PAGE";
  return new Promise((done) => {
    frame.onload = () => done([frame.contentDocument, frame.contentWindow]);
    document.body.append(frame);
  });
}
async function all() {
  for (const width of WIDTHS) {
    const [page, view] = await look(width);
    const root = page.documentElement;
    // What reaches beyond the page must lie in something that scrolls.
    const scrolls = (each) => each.closest(".wide, .plot, nav");
    const cut = [...page.querySelectorAll("main *")].filter((each) =>
      each.getBoundingClientRect().right > width + 1 && !scrolls(each));
    const tags = cut.map((each) => each.outerHTML.slice(0, 80));
    found.widths[width] = [root.scrollWidth, view.innerWidth, tags];
  }
  const [page] = await look(1200);
  const frame = page.querySelector("#generalisation .wide");
  const table = frame.querySelector("table");
  const rows = () => [...table.tBodies[0].rows];
  const column = () => rows().map((row) => parseFloat(row.cells[2].textContent));
  const button = table.tHead.rows[0].cells[2].querySelector("button");
  button.click();
  found.falling = column();
  button.click();
  found.rising = column();
  found.sorted = table.tHead.rows[0].cells[2].getAttribute("aria-sort");
  const box = frame.previousElementSibling.querySelector("input");
  box.value = "svm_pair";
  box.dispatchEvent(new Event("input"));
  found.left = rows().filter((row) => !row.hidden).map((row) => row.cells[0].textContent);
  const range = page.querySelector(".pair input");
  range.value = 20;
  range.dispatchEvent(new Event("input"));
  found.cut = page.querySelector(".pair .both").style.getPropertyValue("--cut");
  const told = document.createElement("pre");
  told.textContent = JSON.stringify(found);
  document.body.replaceChildren(told);
}
all();
</script>"""


def browsed(page, tmp_path):
    """Return what the page around the report has found, and what the browser complained about."""
    around = tmp_path / "around.html"
    text = AROUND.replace("PAGE", page.as_uri()).replace("WIDTHS", json.dumps(WIDTHS))
    around.write_text(text)
    command = [
        CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
        "--enable-logging=stderr", "--allow-file-access-from-files", "--virtual-time-budget=20000",
        "--dump-dom",
        f"--user-data-dir={tmp_path / 'profile'}", around.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    complaints = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    told = re.search("<pre>(.*)</pre>", done.stdout)
    assert told, complaints
    return json.loads(unescape(told[1])), complaints


def test_the_report_fits_every_width_and_its_script_works(compared, tmp_path):
    found, complaints = browsed(compared / "report.html", tmp_path)
    assert complaints == []
    for width in WIDTHS:
        assert found["widths"][str(width)] == [width, width, []]
    falling = [value for value in found["falling"] if value is not None]
    assert len({*falling}) > 3 and falling == sorted(falling, reverse=True)
    assert found["rising"] == falling[::-1] and found["sorted"] == "ascending"
    assert {*found["left"]} == {"svm_pair"} and len(found["left"]) < len(falling)
    assert found["cut"] == "20%"
