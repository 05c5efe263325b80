"""The page: everything inside, nothing outside, texts escaped."""

from __future__ import annotations

from dashboards import page


def text(*claims: page.Claim) -> str:
    picture = page.Picture("fig1", "a <picture>", b"\x89PNG")
    section = page.Section("fig1", "Fig. 1", (picture,), claims, ("swarm run one",))
    return page.html(page.Page("title", ("3 < 4", "more"), ("a & b",), (section,)))


def test_page_holds_its_pictures_and_escapes_its_texts() -> None:
    made = text()
    assert 'src="data:image/png;base64,iVBORw=="' in made
    assert "a &lt;picture&gt;" in made
    assert "3 &lt; 4 &middot; more" in made
    assert '<p class="missed">a &amp; b</p>' in made
    assert "http" not in made


def test_page_says_of_every_claim_whether_it_is_met() -> None:
    made = text(
        page.Claim("fig1", "first", "0.1 m", True), page.Claim("fig1", "second", "0.2 m", False)
    )
    assert made.count("<td>first</td><td>0.1 m</td>") == 2  # in the table of all, and its figure's
    assert made.count(">met</td>") == 2
    assert made.count(">NOT MET</td>") == 2
