"""The page in a real browser: it asks for nothing, and reads wide and narrow, day and night."""

from __future__ import annotations

import io
import re
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from PIL import Image

from sniffer.decoding.options import Options
from sniffer.jobs.report import report as write
from tests.browser import Browser, chromium

if TYPE_CHECKING:
    from collections.abc import Iterator

    from sniffer.decoding.called import Named

SAMPLES: Final = Path(__file__).parents[1] / "sample_captures"
WIDTHS: Final = (1280, 390)
SCHEMES: Final = ("light", "dark")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    chromium()
    path = tmp_path_factory.mktemp("page") / "report.html"
    write(SAMPLES / "mightyzap_damaged.log", path)
    return path


@pytest.fixture(scope="module")
def window(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with Browser(tmp_path_factory.mktemp("profile")) as browser:
        yield browser


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("width", WIDTHS)
def test_the_page_asks_for_no_address_and_has_nothing_to_complain_of(
    width: int, scheme: str, page: Path, window: Browser
) -> None:
    window.open(page, width=width, scheme=scheme)
    assert window.asked == [page.as_uri()]
    assert window.said == []


@pytest.mark.parametrize("width", WIDTHS)
def test_the_page_is_no_wider_than_its_window(width: int, page: Path, window: Browser) -> None:
    window.open(page, width=width)
    assert window.eval("document.documentElement.scrollWidth") <= width
    # what is wider than the window is moved by itself
    wide = window.eval(
        "[...document.querySelectorAll('body *')].filter(e => !e.closest('.wide, svg'))"
        ".filter(e => e.getBoundingClientRect().right > innerWidth + 1).map(e => e.outerHTML)"
    )
    assert wide == []


def test_on_a_usual_screen_the_table_of_the_servos_is_seen_whole(
    page: Path, window: Browser
) -> None:
    window.open(page, width=1280)
    assert window.eval("document.querySelector('.servos').parentElement.clientWidth") > 1000
    hidden = "(e => e.scrollWidth - e.parentElement.clientWidth)(document.querySelector('.servos'))"
    assert window.eval(hidden) <= 0


def test_a_row_of_the_servos_has_three_lines_at_most_whatever_they_are_called(
    tmp_path: Path, window: Browser
) -> None:
    """Three response times stood below each other beside names of 32 signs."""
    path = tmp_path / "named.html"
    names: dict[Named, str] = {
        servo: f"left_front_hip_yaw_joint_upper_{servo}" for servo in (1, 2, 3)
    }
    write(SAMPLES / "mightyzap_damaged.log", path, Options(names=names))
    window.open(path, width=1280)
    lines = window.eval(
        "[...document.querySelectorAll('.servos tbody tr')].map(r => "
        "r.getBoundingClientRect().height / parseFloat(getComputedStyle(r).lineHeight))"
    )
    assert max(lines) < 3.6


@pytest.mark.parametrize("width", WIDTHS)
def test_the_verdict_is_on_the_first_screen(width: int, page: Path, window: Browser) -> None:
    window.open(page, width=width, height=800)
    bottom = window.eval("document.querySelector('#verdict .next').getBoundingClientRect().bottom")
    assert 0 < bottom < 800


@pytest.mark.parametrize("scheme", SCHEMES)
def test_text_has_the_contrast_that_readers_need(scheme: str, page: Path, window: Browser) -> None:
    """At least 4.5 to 1 (WCAG 2.2, 1.4.3)."""
    window.open(page, scheme=scheme)
    found = window.eval(CONTRASTS)
    assert len(found) > 5
    assert min(found.values()) >= 4.5, found


CONTRASTS: Final = """(() => {
  const light = (c) => {
    const [r, g, b] = c.match(/[\\d.]+/g).slice(0, 3).map((v) => {
      const s = v / 255;
      return s <= 0.04045 ? s / 12.92 : ((s + 0.055) / 1.055) ** 2.4;
    });
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const ground = (e) => {
    for (; e; e = e.parentElement) {
      const c = getComputedStyle(e).backgroundColor;
      if (!/, 0\\)|transparent/.test(c)) return c;
    }
    return getComputedStyle(document.body).backgroundColor;
  };
  const out = {};
  for (const e of document.querySelectorAll("h1,h2,h3,p,td,th,a,code,figcaption,li,.name,.value")) {
    const [a, b] = [light(getComputedStyle(e).color), light(ground(e))].sort((x, y) => y - x);
    out[`${e.tagName}.${e.className}`] = (a + 0.05) / (b + 0.05);
  }
  return out;
})()"""


def test_day_and_night_differ_and_neither_is_empty(page: Path, window: Browser) -> None:
    means = {}
    for scheme in SCHEMES:
        window.open(page, scheme=scheme)
        picture = np.asarray(Image.open(io.BytesIO(window.picture())).convert("RGB"))
        assert picture.std() > 5
        means[scheme] = float(picture.mean())
    assert means["light"] > 200
    assert means["dark"] < 60


@pytest.mark.parametrize("width", WIDTHS)
def test_curves_are_drawn_where_they_stand(width: int, page: Path, window: Browser) -> None:
    window.open(page, width=width)
    sizes = window.eval(
        "[...document.querySelectorAll('.plot svg')].map(s => {"
        "const b = s.getBoundingClientRect(); return [b.width, b.height]})"
    )
    assert len(sizes) > 15
    assert min(w for w, _ in sizes) > 200
    assert min(h for _, h in sizes) > 30
    drawn = window.eval(
        "[...document.querySelectorAll('.plot path.line.position')].map(p => p.getTotalLength())"
    )
    assert len(drawn) == 3
    assert min(drawn) > 500


def test_a_stretch_of_time_is_looked_at_closer_and_left_again(page: Path, window: Browser) -> None:
    window.open(page)
    svg = "document.querySelector('.servo .plot svg')"
    window.eval(f"{svg}.scrollIntoView({{block: 'center'}})")
    left, top, width, height = window.eval(
        f"(b => [b.left, b.top, b.width, b.height])({svg}.getBoundingClientRect())"
    )
    y = top + height / 2
    whole = window.eval(f"{svg}.getAttribute('viewBox')")
    window.drag((left + 0.25 * width, y), (left + 0.5 * width, y))
    told = window.eval("document.querySelector('.servo output').textContent")
    assert re.search(r"goal -?[\d.]+, position -?[\d.]+", told)
    first, _, size, _ = (float(n) for n in window.eval(f"{svg}.getAttribute('viewBox')").split())
    full = float(whole.split()[2])
    assert first == pytest.approx(0.25 * full, abs=0.01 * full)
    assert size == pytest.approx(0.25 * full, abs=0.02 * full)
    assert window.eval("document.querySelector('#whole').hidden") is False
    window.eval("document.querySelector('#whole').click()")
    assert window.eval(f"{svg}.getAttribute('viewBox')") == whole
    assert window.said == []


def test_without_its_script_the_page_says_the_same(page: Path, window: Browser) -> None:
    window.open(page)
    said = window.eval("document.body.innerText")
    window.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        window.open(page)
        assert window.eval("document.body.innerText") == said
    finally:
        window.call("Emulation.setScriptExecutionDisabled", value=False)


def test_a_script_that_got_into_the_page_would_not_run(page: Path, window: Browser) -> None:
    evil = page.with_name("evil.html")
    text = page.read_text(encoding="utf-8")
    bad = (
        "<script>document.title = 'mine'</script><img src=x onerror=\"document.title='mine'\">"
        "<img src='http://127.0.0.1:9/x.png'><link rel=stylesheet href='http://127.0.0.1:9/x.css'>"
    )
    evil.write_text(text.replace("<header>", bad + "<header>"), encoding="utf-8")
    window.open(evil)
    assert window.eval("document.title") != "mine"
    assert all(url.startswith("file:") for url in window.asked if "127.0.0.1" not in url)
    refused = [line for line in window.said if "Content Security Policy" in line]
    assert len(refused) >= 4


def test_the_page_is_printed_on_paper_with_all_it_says(page: Path, window: Browser) -> None:
    window.open(page, scheme="dark")
    pdf = window.printed()
    assert pdf.startswith(b"%PDF")
    pages = len(re.findall(rb"/Type\s*/Page\b", pdf))
    assert 3 <= pages <= 30
    window.call("Emulation.setEmulatedMedia", media="print")
    assert window.eval("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert window.eval("getComputedStyle(document.querySelector('nav')).display") == "none"
    window.call("Emulation.setEmulatedMedia", media="")
