"""Views of a class: complete, safe against names and messages, and true to the records."""

import base64
import hashlib
import io
import json
import re
from dataclasses import replace
from html.parser import HTMLParser

import numpy as np
import pytest
from rich.console import Console

from grader.reports import html, overview, terminal
from grader.result import CriterionResult, Episode, Result, SpeedResult, Trace, VariantResult

ENVIRONMENT = {"isolation": "tier 2", "secret": "0123456789ab", "python": "3.12"}
HOSTILE = "</script><img src=x onerror=alert(1)>[red]{{ 7 * 7 }}\u2028"


def criterion(metric, points, most, value, reference=0.3):
    return CriterionResult(metric, points, most, 1.5, 3.0, value, reference)


def make(name="ana", points=70.0, message="", failing=False, **changes):
    """A graded result of two variants, with a trace of three steps; `failing` spoils one episode."""
    good = Episode(0, "ok", "", {"best half": 0.4, "within 90 %": 0.8}, {"best half": 0.3, "within 90 %": 0.9})
    bad = Episode(1, "crashed", message, {}, {"best half": 0.3, "within 90 %": 0.9})
    first = VariantResult(
        "default",
        "the exercise as it is",
        [criterion("best half", points - 30.0, 50.0, 0.4), criterion("energy score", 10.0, 20.0, 0.6)],
        [good, bad if failing else replace(good, index=1)],
    )
    second = VariantResult("silent", "silent sensors", [criterion("best half", 10.0, 20.0, 0.9)], [good])
    trace = Trace(
        variant="default",
        episode=0,
        metric="best half",
        error=[0.1, 0.2, 0.9],
        reference_error=[0.1, 0.2, 0.3],
        truth=[[[0, 0], [1, 1], [2, 2]], [[5, 5], [4, 4], [3, 3]]],
        frames=[{"step": k, "particles": [[[k, 1.25], [4.0, 0.5]], [[3.0, 3.0]]]} for k in range(3)],
        picture={
            "room": [0.0, 0.0, 5.0, 5.0],
            "sensors": [[0, 0, "S4"]],
            "targets": ["robot A", "robot B"],
            "unit": "m",
        },
    )
    fields = {
        "submission": name,
        "path": f"class/{name}.py",
        "digest": "ab" * 32,
        "assignment": "vacuum",
        "status": "graded",
        "message": message,
        "points": points,
        "max_points": 100.0,
        "variants": [first, second],
        "speed": SpeedResult("ok", "", 4.0, 2.0, [2.1, 2.0, 1.9], 10.0, 10.0, 10.0, 60.0),
        "trace": trace,
        "environment": ENVIRONMENT,
        "interval": [points - 4.25, points + 2.0],
        "confidence": 0.95,
        "stopped": "the interval is narrow enough",
    }
    return Result(**{**fields, **changes})


def refuse(name="ben", message="defines no Estimator"):
    return Result(name, f"class/{name}.py", "", "vacuum", "refused", message, 0.0, 100.0, environment=ENVIRONMENT)


UNTIMED = SpeedResult("crashed", "at step 3", None, None, [], 0.0, 10.0, 10.0, 60.0)
LANDMARKS = {"error": ((0.4, "a filter of old"),)}


def render(*results):
    return html.render(list(results), "Two robots", "2026-11-22", LANDMARKS)


class Page(HTMLParser):
    """What a browser makes of the report: tags with attributes, text, and the content of scripts."""

    def __init__(self, text):
        super().__init__()
        self.tags, self.words, self.scripts, self._inside = [], [], [], ""
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._inside = tag
        if tag == "script":
            self.scripts.append("")

    def handle_endtag(self, tag):
        self._inside = ""

    def handle_data(self, data):
        if self._inside == "script":
            self.scripts[-1] += data
        elif self._inside != "style":
            self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())


def printed(renderable, width=100):
    console = Console(width=width, file=io.StringIO(), color_system=None)
    console.print(renderable)
    return console.file.getvalue()


# The page


def test_every_result_appears_and_failures_have_their_line():
    results = [make("ana"), make("cem", message="line 3: KeyError: 'x'", failing=True), refuse("ben", "no Estimator")]
    text = Page(render(*results)).text
    assert all(name in text for name in ("ana", "ben", "cem"))
    assert "refused: no Estimator" in text
    assert "episode 1: crashed: line 3: KeyError: 'x'" in text
    assert "Two robots" in text and "2026-11-22" in text
    assert "tier 2" in text and "0123456789ab" in text


def test_points_and_figures_are_the_records():
    text = Page(render(make(points=71.5))).text
    assert "71.5 / 100" in text and "41.5 / 50" in text
    assert "0.400 (0.300)" in text and "×2.00" in text
    assert "within 90 % 0.80 (0.90)" in text
    assert "in 80 % of all steps (the reference’s: 90 %)." in text


def test_points_have_their_interval_and_the_episodes_they_rest_on():
    text = Page(render(make(points=71.5, speed=replace(make().speed, bound=1.75)))).text
    assert "71.5 / 100 67.2–73.5" in text
    assert "3 episodes; the interval is narrow enough." in text
    assert "Infinitely many would give 67.2–73.5 points, with 95 % confidence." in text
    assert "at least ×1.75 the reference’s, with 95 % confidence" in text
    given_up = make(interval=None, confidence=None, stopped="patience is lost")
    assert "3 episodes; patience is lost." in Page(render(given_up)).text
    assert "Infinitely" not in Page(render(given_up, refuse())).text
    assert "70.0 3 0.400" in " ".join(printed(terminal.table([given_up]), 110).split())


def test_different_environments_are_not_shown_as_one():
    text = Page(render(make("ana"), make("ben", environment={"secret": "other"}))).text
    assert "Graded in different environments" in text


@pytest.mark.parametrize(
    "name",
    [
        "<script>alert(1)</script>",
        '" onclick="alert(1)',
        "' onmouseover='alert(1)",
        "=cmd|' /C calc'!A0",
        "--><!-- </style></title></textarea>",
        "{% raw %}{{ 7 * 7 }}",
        "javascript:alert(1)//\\",
        HOSTILE,
    ],
)
def test_names_and_messages_stay_text(name):
    trace = make().trace
    picture = trace.picture | {"targets": [name, name], "unit": name, "sensors": [[0, 0, name]]}
    trace = replace(trace, variant=name, metric=name, picture=picture)
    speed = replace(make().speed, status=name, message=name)
    harmless = Page(
        render(make("ana", message="m", failing=True, speed=replace(speed, message="m")), refuse("ben", "m"))
    )
    hostile = make(name, message=name, failing=True, path=name, trace=trace, speed=speed, stopped=name, digest=name)
    page = Page(render(hostile, refuse(name, name)))
    names = [(tag, sorted(attributes)) for tag, attributes in page.tags]
    assert names == [(tag, sorted(attributes)) for tag, attributes in harmless.tags]
    assert " ".join(name.split()) in page.text


def test_embedded_data_cannot_end_its_script():
    trace = make().trace
    trace = replace(trace, picture=trace.picture | {"sensors": [[0, 0, HOSTILE]]})
    text = render(make(trace=trace))
    data, _ = Page(text).scripts
    assert "<" not in data and "\u2028" not in data
    assert json.loads(data)["sensors"] == [[0, 0, HOSTILE]]


@pytest.mark.parametrize("name", ["\udc80", "a\x00b", "\x1b[31mred\x1b]0;title\x07", "\u202egnp.exe", "\x85\u2029\r"])
def test_what_is_no_character_reaches_no_terminal_and_stops_no_report(tmp_path, name):
    results = [make(name, message=name, path=name), refuse(name, name)]
    html.write(results, tmp_path / "report.html", "Two robots", "2026-11-22", LANDMARKS)
    assert "Two robots" in (tmp_path / "report.html").read_text(encoding="utf-8")
    text = printed(terminal.table(results), 110).encode("utf-8").decode()
    assert not any(c in text for c in name if not c.isprintable())


def test_the_file_needs_nothing_else():
    text = render(make(), refuse())
    assert not re.search(r"https?:|\bsrc\s*=|@import|url\((?!#)", text)
    assert not any(tag in ("link", "iframe", "img", "object", "embed") for tag, _ in Page(text).tags)


def test_only_the_reports_own_script_may_run():
    page = Page(render(make()))
    [policy] = [a["content"] for tag, a in page.tags if a.get("http-equiv") == "Content-Security-Policy"]
    digest = base64.b64encode(hashlib.sha256(page.scripts[-1].encode()).digest()).decode()
    assert policy == f"default-src 'none'; style-src 'unsafe-inline'; script-src 'sha256-{digest}'"
    assert not any(name.startswith("on") for _, attributes in page.tags for name in attributes)


def test_pictures_have_words():
    for tag, attributes in Page(render(make(), refuse())).tags:
        if attributes.get("role") == "img":
            assert attributes.get("aria-label") or attributes.get("data-label")
        assert tag != "canvas" or attributes["role"] == "img"


def test_a_map_of_rings_reaches_its_drawing():
    trace = make().trace
    slanted = [[[0.0, 0.0], [5.0, 1.0], [2.0, 5.0]], [[1.0, 1.0], [2.0, 1.5], [1.5, 2.0]]]
    mapped = replace(trace, picture=trace.picture | {"rings": slanted})
    assert html.pack(mapped)["rings"] == slanted and html.pack(trace)["rings"] == []
    page = Page(render(make(trace=mapped)))
    assert '"rings": [[[0.0, 0.0], [5.0, 1.0], [2.0, 5.0]]' in page.scripts[0] and "data.rings" in page.scripts[-1]


def test_nothing_graded_and_nothing_at_all_are_reports_too():
    assert "no Estimator" in Page(render(refuse("ben", "no Estimator"))).text
    assert "Two robots" in Page(render()).text
    assert "error of a filter of old 0.4" in Page(render()).text
    assert "ana" in Page(render(make(speed=None, trace=None, variants=[]))).text


def test_a_submission_of_which_nothing_finished_is_shown():
    failed = [Episode(i, "timeout", "too long", {}, {"best half": 0.3, "within 90 %": 0.9}) for i in range(28)]
    nothing = [criterion("best half", 0.0, 50.0, None), criterion("energy score", 0.0, 20.0, None)]
    variants = [VariantResult("default", "as it is", nothing, failed)]
    bad = make(points=0.0, variants=variants, speed=None, trace=None, interval=None, stopped="patience is lost")
    assert "28 episodes; patience is lost." in Page(render(make(), bad)).text
    text = printed(terminal.table([make("heading_unwound_in_a_loop"), bad]), 110)
    assert "28 failed" in text and max(map(len, text.splitlines())) <= 110


def test_a_submission_that_fails_at_once_has_no_picture():
    trace = replace(make().trace, frames=[], error=[])
    assert not any(tag == "canvas" for tag, _ in Page(render(make(trace=trace))).tags)


# What the page is made of


def test_histogram_counts_everyone_once():
    points = [0.0, 0.0, 9.99, 10.0, 55.0, 99.9, 100.0]
    bins = html.histogram([make(points=p) for p in points] + [refuse()])
    assert bins == [[3, 1], [1, 0], [0, 0], [0, 0], [0, 0], [1, 0], [0, 0], [0, 0], [0, 0], [2, 0]]
    counts = [
        int(a["data-count"]) for _, a in Page(render(*[make(points=p) for p in points])).tags if "data-count" in a
    ]
    assert sum(counts) == len(points)


@pytest.mark.parametrize(("full", "none"), [(1.45, 3.1), (1.01, 1.15), (10.0, 60.0)])
def test_scales_show_both_thresholds_and_keep_marks_inside(full, none):
    at = html.scale(full, none, [0.0, full, (full + none) / 2, none, 1e9], 100.0)
    assert 0.0 <= at["reference"] < at["full"] < at["none"] < 100.0
    assert at["marks"] == sorted(at["marks"]) and at["marks"][1] == at["full"] and at["marks"][3] == at["none"]
    assert 0.0 <= at["marks"][0] and at["marks"][-1] == 100.0


def test_packed_clouds_unpack_to_a_255th_of_their_extent():
    rng = np.random.default_rng(5)
    cloud = rng.normal([1.0, 300.0], [0.1, 20.0], size=(120, 2))
    trace = replace(make().trace, frames=[{"step": 0, "particles": [cloud.tolist(), [[1e300, -1e300]], []]}])
    [[step, [(text, (x0, x1, y0, y1)), far, none]]] = html.pack(trace)["frames"]
    levels = np.frombuffer(base64.b64decode(text), np.uint8).reshape(-1, 2)
    unpacked = [x0, y0] + levels / 255.0 * [x1 - x0, y1 - y0]
    assert step == 0
    assert np.all(np.abs(unpacked - cloud) <= 0.51 * np.ptp(cloud, axis=0) / 255.0 + 1e-3)
    assert far[1] == [1e6, 1e6, -1e6, -1e6] and none[0] == ""


def test_error_curves_stay_in_their_box():
    trace = replace(make().trace, error=[0.1, 1e9])
    drawn = html.curves(trace, 100.0, 50.0)
    points = [[float(c) for c in point.split(",")] for point in drawn["error"][1:].split("L")]
    assert drawn["clipped"] and points[1] == [50.0, 0.0]
    assert html.curves(replace(trace, error=[]), 100.0, 50.0)["error"] == ""


def test_writing_is_whole_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / "report.html"
    html.write([make()], path, "Two robots", "2026-11-22", LANDMARKS)
    before = path.read_text(encoding="utf-8")
    assert before == render(make())
    monkeypatch.setattr(html.os, "replace", lambda *_: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        html.write([make("ben")], path, "Two robots", "2026-11-22", LANDMARKS)
    assert path.read_text(encoding="utf-8") == before
    assert list(tmp_path.iterdir()) == [path]
    with pytest.raises(OSError):
        html.write([make()], tmp_path / "absent" / "report.html", "", "", {})


def test_overview():
    assert overview.standing(make()) == "ok"
    assert overview.standing(make(failing=True)) == overview.standing(make(speed=UNTIMED)) == "failing"
    assert overview.standing(refuse()) == "refused"
    assert overview.worst_variant(make(points=70.0)).name == "default"
    assert overview.worst_variant(make(points=90.0)).name == "silent"
    assert overview.spread([refuse(), *(make(points=p) for p in (10.0, 20.0, 30.0, 40.0, 50.0))]) == (
        10,
        20,
        30,
        40,
        50,
    )
    assert overview.spread([make(points=7.0)]) == (7, 7, 7, 7, 7)
    assert overview.spread([refuse()]) is None


# The terminal


def test_table_fits_110_columns_and_says_failures_in_words():
    results = [
        make("ana"),
        make("a" * 40, points=30.0, message="1 of 3 episodes failed: line 3: KeyError: 'x'", failing=True),
        make("dora", speed=UNTIMED),
        make("emil", failing=True),
        refuse("ben", "defines no Estimator"),
    ]
    text = printed(terminal.table(results), 110)
    assert max(map(len, text.splitlines())) <= 110
    words = " ".join(text.split())
    assert "ana 70.0 (66–72) 3 0.400 ×1.33 ×2.00 0.80 ×2.00 default -20.0 ok" in words
    assert "– refused" in words and "not timed" in words and "1 failed" in words and "(95 % sure)" in words
    assert "ben: defines no Estimator" in words and "line 3: KeyError: 'x'" in words


def test_markup_in_names_and_messages_is_printed_as_it_is():
    text = " ".join(printed(terminal.table([refuse("[red]ana[/]", "[/nonsense] [link=x]")])).split())
    assert "[red]ana[/]" in text and "[/nonsense] [link=x]" in text


def test_summary():
    results = [*(make(points=p) for p in (40.0, 50.0, 60.0)), refuse(), make(failing=True, points=70.0)]
    line = printed(terminal.summary(results, {}), width=200)
    assert "5 submissions, 1 refused, 1 with failures" in line
    assert "median 55.0, middle half 47.5 to 62.5, all 40.0 to 70.0" in line
    assert printed(terminal.summary([refuse()], {})) == "1 submission, 1 refused\n"


# Whether posteriors mean what they say, and under what isolation that was found


def sure(name="sure", **changes):
    """A result whose posteriors never hold the truth, and whose Gaussians say so too."""
    values = {"best half": 0.3, "within 90 %": 0.0, "NEES": 60.0}
    episodes = [Episode(i, "ok", "", values, {"best half": 0.3, "within 90 %": 0.9}) for i in range(4)]
    criteria = [criterion("best half", 50.0, 50.0, 0.3), criterion("energy score", 0.0, 20.0, 0.9)]
    variant = VariantResult("default", "as it is", criteria, episodes)
    return make(name, variants=[variant], dimension=6, **changes)


def test_an_overconfident_filter_is_called_so():
    text = render(make("ana"), sure())
    # In its row, and of both measures in its variant.
    assert text.count('class="verdict"') == 3
    page = Page(text).text
    assert "in 0 % of all steps (the reference’s: 90 %): overconfident ." in page
    assert "NEES of the Gaussian posteriors: 60.0, expected 2.71 to 10.7: overconfident ." in page
    text = printed(terminal.table([make("ana"), sure()]), 110)
    assert "0.00↓" in text and "0.80↓" not in text
    assert "↓ overconfident" in printed(terminal.summary([sure()], {}), 120)
    assert "↓" not in printed(terminal.summary([make("ana")], {}), 120)


def test_the_isolation_is_prominent_and_red_when_there_is_none():
    weak = make("ben", environment=ENVIRONMENT | {"isolation": "tier 0: resource limits only"})
    nothing = replace(refuse("cem"), environment=ENVIRONMENT | {"isolation": "nothing was run"})
    for results, tiers, alarm in (
        ([make("ana"), nothing], ["tier 2"], False),
        ([make("ana"), weak], ["tier 0: resource limits only", "tier 2"], True),
    ):
        text = render(*results)
        lines = re.findall(r'<p class="(trust[^"]*)">Isolation: ([^<]*)</p>', text)
        assert [words.split(". ")[0] for _, words in lines] == tiers
        assert ("trust bad" in [style for style, _ in lines]) == alarm
        # What differs in nothing else is one environment.
        assert "0123456789ab" in Page(text).text and "different environments" not in Page(text).text
        summary = terminal.summary(results, {})
        assert f"Isolation: {tiers[0]}" in summary.plain
        assert any("red" in str(span.style) for span in summary.spans) == alarm
