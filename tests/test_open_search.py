"""A search for words in a long capture: it is quick, keys are obeyed meanwhile, Esc stops it."""

from __future__ import annotations

import asyncio
import random
from typing import TYPE_CHECKING, Final

import numpy as np
import pytest
from textual.events import Key

from bench.streams import STREAMS
from sniffer.inside.search import WORDS, Search
from sniffer.inside.sieve import WordSieve
from sniffer.inside.texts import SearchedTexts
from sniffer.inside.view import LineView
from tests.lists import in_turn
from tests.test_open import CAPTURES, indexed, judged
from tests.test_open_screen import looking

if TYPE_CHECKING:
    from pathlib import Path

    from sniffer.ground.model import I64
    from tests.test_open_screen import Glass

SIZE: Final = 2_500_000
"""Bytes: two hundred thousand frames, a fifth of the greatest capture that is measured."""


@pytest.fixture(scope="module")
def long_capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("long") / "long.bin"
    path.write_bytes(STREAMS["mightyzap"](SIZE))
    return path


def test_words_that_are_nowhere_are_looked_for_in_pages_not_lines(
    long_capture: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To put each of the lines in words takes three times as long as all that is done here."""
    index = indexed(long_capture)
    assert len(index.lines) > 200_000
    worded, texts_of = list[int](), SearchedTexts.of

    def noted(texts: SearchedTexts, numbers: I64) -> list[str]:
        worded.extend(numbers.tolist())
        return texts_of(texts, numbers)

    monkeypatch.setattr(SearchedTexts, "of", noted)
    for words, there in (("nowhere at all", False), ("load_data", True)):
        search = Search(LineView(index), 0, words)
        while (at := search.steps()) is None:
            pass
        assert (at >= 0) == there
        assert len(worded) <= WORDS * there, "as many lines as are put in words at once"
    index.discard()


def test_keys_are_obeyed_while_words_are_looked_for_and_esc_stops_that(long_capture: Path) -> None:
    async def what(glass: Glass) -> None:
        app = glass.app

        def press(key: str, character: str | None = None) -> None:
            app.post_message(Key(key, character))  # a pilot would wait until all is done

        await glass.press("slash")
        app.prompt.value = "nowhere at all"
        press("enter")
        while app._search is None or not app._search.done:
            await asyncio.sleep(0.001)
        before = app.list.cursor
        for _ in range(3):
            press("down")
        while app.list.cursor < before + 3:
            await asyncio.sleep(0.001)
        assert app._search is not None, "it goes on meanwhile"
        press("escape")
        while app._search is not None:
            await asyncio.sleep(0.001)
        assert glass.text(app.status).startswith("the search was stopped")
        assert app.list.cursor == before + 3

    async def all_of_it() -> None:
        async with looking(long_capture) as glass:
            await what(glass)

    asyncio.run(all_of_it())


@in_turn(4)
@pytest.mark.parametrize("exchanges", [False, True])
@pytest.mark.parametrize("path", CAPTURES, ids=lambda p: p.name)
def test_no_line_that_holds_a_text_is_passed_over(path: Path, exchanges: bool) -> None:
    index = indexed(path)
    view = LineView(index)
    view.choose(None, exchanges=exchanges)
    shown = judged(view).shown()
    texts = SearchedTexts(index, exchanges=exchanges).of(shown)
    draw = random.Random(path.name)
    for _ in range(25):
        text = draw.choice(texts)
        begin = draw.randrange(len(text))
        wanted = text[begin : begin + draw.choice((1, 2, 3, 5, 8, 20, 60))].strip()
        holds = [wanted.lower() in told.lower() for told in texts]
        sieve = WordSieve(index, wanted, exchanges=exchanges)
        at = len(shown) // 3
        may = np.concatenate([sieve.may(shown[:at]), sieve.may(shown[at:])])
        assert may[holds].all(), wanted
    assert not WordSieve(index, "nowhere", exchanges=exchanges).may(shown).any()
    index.discard()
