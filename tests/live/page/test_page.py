"""The page in a browser, as a visitor meets it."""

from __future__ import annotations

import base64
import csv
import io
import re
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import imageio.v3 as iio
import numpy as np
import pytest
from PIL import Image
from serving import PATIENCE, SMALL, Served

from taichi_foam.records.history import HISTORY_COLUMNS
from taichi_foam.results.result import Result

CHROMIUM, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
pytestmark = pytest.mark.skipif(
    not (CHROMIUM and DRIVER), reason="needs Debian's chromium and chromium-driver"
)
if CHROMIUM and DRIVER:
    from selenium.webdriver import ActionChains, Chrome, ChromeOptions, Keys
    from selenium.webdriver.chrome.service import Service
    from selenium.webdriver.common.by import By

END = ("numerics.end=0.2",)  # twenty seconds at the pace that a server begins with


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    served = Served(tmp_path_factory.mktemp("served"), *SMALL, *END)
    yield served
    served.stop()


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    """A browser without a window, with a profile of its own."""
    folder = tmp_path_factory.mktemp("browser")
    options = ChromeOptions()
    options.binary_location = str(CHROMIUM)
    words = "headless=new no-sandbox disable-gpu disable-quic no-first-run disable-sync"
    quiet = "disable-background-networking disable-component-update disable-dev-shm-usage"
    sized = f"user-data-dir={folder / 'profile'} window-size=1280,900"
    for word in f"{words} {quiet} {sized}".split():
        options.add_argument(f"--{word}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = Chrome(options=options, service=Service(DRIVER))
    yield driver
    driver.quit()


class Page:
    """What a visitor can see and do."""

    def __init__(self, driver: Chrome, address: str) -> None:
        self.driver = driver
        self.address = address
        driver.get(address)

    def __getitem__(self, selector: str) -> Any:
        return self.driver.find_element(By.CSS_SELECTOR, selector)

    def ask(self, script: str, *given: Any) -> Any:
        return self.driver.execute_script(f"return {script}", *given)

    def text(self, selector: str) -> str:
        return self.ask("document.querySelector(arguments[0]).textContent", selector)

    def until(self, is_it: Callable[[], Any], patience: float = PATIENCE) -> Any:
        """Wait until something holds, and return it."""
        end = time.monotonic() + patience
        while time.monotonic() < end:
            found = is_it()
            if found:
                return found
            time.sleep(0.05)
        raise AssertionError(f"not so, at the state {self.text('#state')!r}")

    def picture(self) -> np.ndarray:
        """The canvas as it is (height, width, 3)."""
        url = self.ask("document.getElementById('picture').toDataURL()")
        content = base64.b64decode(url.partition(",")[2])
        return np.asarray(Image.open(io.BytesIO(content)).convert("RGB")).astype(float)

    def curve(self) -> list[float]:
        """Times of the current curve's points [ms], as they are drawn."""
        return self.ask("(document.getElementById('curve').data ?? []).at(-1)?.x ?? []")

    def figure(self, name: str) -> str:
        """The number of the first key figure whose name has these words."""
        row = "[...document.querySelectorAll('#figures tbody tr')].find((tr) => "
        return self.ask(
            f"{row}tr.textContent.includes(arguments[0]))?.children[1].textContent", name
        )

    def drop(self) -> int:
        """How many drops are over and saved."""
        return self.ask("document.querySelectorAll('#list a[href$=\".csv\"]').length")

    def errors(self) -> list[str]:
        """What the browser has complained about."""
        return [str(entry["message"]) for entry in self.driver.get_log("browser")]

    def width(self, width: int, height: int, scheme: str = "light") -> None:
        """Show the page on a screen of this size."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", media)


@pytest.fixture
def page(browser: Chrome, server: Served) -> Iterator[Page]:
    found = Page(browser, server.address)
    found.width(1280, 900)
    found.until(lambda: found.text("#state") != "connecting")
    yield found
    assert found.errors() == []


def test_the_picture_moves_and_the_curve_grows(page: Page) -> None:
    page.until(lambda: page.text("#state") in ("running", "ended"))
    page["#reset"].click()  # a browser may need longer to begin than a drop to end
    page.until(lambda: page.text("#state") == "running")
    page.until(lambda: len(page.curve()) > 5)
    before, points = page.picture(), len(page.curve())
    time_before = float(page.text("#time"))
    page.until(lambda: float(page.text("#time")) > time_before + 3.0)
    page.until(lambda: len(page.curve()) > points)
    after = page.picture()
    assert before.shape == after.shape
    # the impactor has sunk by millimetres of a window of a quarter of a metre: more than one in
    # two hundred pixels is another colour, by more than any encoder's rounding
    changed = np.abs(after - before).max(axis=2) > 8
    assert changed.mean() > 0.005
    assert float(page.text("#displacement")) > 0


def test_new_settings_are_dropped_and_the_result_comes_home(
    page: Page, server: Served, tmp_path: Path
) -> None:
    page.until(lambda: page.text("#state") in ("running", "ended"))
    page["#reset"].click()
    page.until(lambda: page.text("#state") == "running")
    page["#impactor-velocity ~ input[type=range]"].send_keys(*[Keys.ARROW_RIGHT] * 7)
    assert page["#impactor-velocity"].get_property("value") == "3"
    page["#pace"].send_keys("fastest")
    page["#drop"].click()
    page.until(lambda: page.text("#name") == page.driver.title == "wedge, 3 m/s")
    page.until(lambda: page.text("#state") == "ended")
    first = "#list tbody tr:first-child"
    page.until(lambda: page.text(f"{first} td:nth-child(2)") == "velocity 3 m/s")
    page.until(lambda: page.ask(f"Boolean(document.querySelector('{first} a'))"))

    allow = {"behavior": "allow", "downloadPath": str(tmp_path)}
    page.driver.execute_cdp_cmd("Browser.setDownloadBehavior", allow)
    for name in ("history.csv", "film.mp4"):
        page[f"{first} a[href$='{name}']"].click()

    def come(ending: str) -> Path:
        return page.until(lambda: next(tmp_path.glob(f"*{ending}"), None))

    table, film = come("-history.csv"), come("-film.mp4")
    folder = server.out / table.name.removesuffix("-history.csv")
    result = Result.load(folder)
    assert result.scene.impactor is not None
    assert result.scene.impactor.velocity == 3.0
    with table.open(newline="") as file:
        header, *rows = csv.reader(file)
    assert tuple(header) == HISTORY_COLUMNS
    assert len(rows) == len(result.history["time_s"])
    frames = iio.imread(film)
    assert frames.shape == (len(result.snapshots), 180, 320, 3)

    # the drop before stands beside it as a thin line, and the figures are those of the file
    assert page.ask("document.getElementById('curve').data.length") >= 2
    assert int(page.figure("broken bonds")) == result.history["broken_bonds"][-1] > 0


def test_what_cannot_be_is_told_beside_the_controls(page: Page) -> None:
    page["#groups details:nth-of-type(3) summary"].click()
    for wrong, words in (("1", "must be above -1, below 0"), ("-0.01", "not a valid scene")):
        field = page["#foam-densification_strain"]
        field.send_keys(Keys.CONTROL, "a", Keys.NULL, wrong, Keys.ENTER)
        page.until(lambda words=words: words in page.text("#problem"))
    page["#reset"].click()
    page.until(lambda: page["#foam-densification_strain"].get_property("value") == "-0.8")
    assert not page["#problem"].is_displayed()


def type_in(page: Page, key: str, text: str) -> Any:
    """Type into a control's field in place of what stands there, and leave it uncommitted."""
    field = page[f"#{key}"]
    field.send_keys(Keys.CONTROL, "a", Keys.NULL, Keys.BACKSPACE, text)
    return field


def test_what_cannot_be_stays_marked_in_its_field_and_nothing_drops(
    page: Page, server: Served
) -> None:
    wrong = ("600", "-3", "1e9", "abc", "1,000", "1.000,5", "1,000.5", "0x3", "Infinity", "")
    ways = (
        lambda field: page["#drop"].click(),
        lambda field: field.send_keys(Keys.ENTER),
        lambda field: field.send_keys(Keys.TAB),
    )
    with server.viewer(watches=False) as other:
        before = other.wait_for("scene")["drop"]
        for n, text in enumerate(wrong):
            field = type_in(page, "impactor-velocity", text)
            ways[n % 3](field)
            if n % 3 == 2:
                page["#drop"].click()
            assert field.get_property("value") == text
            assert field.get_attribute("aria-invalid") == "true"
            beside = page["#impactor-velocity-wrong"]
            assert beside.is_displayed()
            assert beside.text == f"{text or 'nothing'}{_WHY.get(text, '')}: must be 0 to 500 m/s"
            assert page.text("#problem") == f"Nothing was dropped. velocity {beside.text}."
            assert page.ask("document.activeElement.id") == "impactor-velocity"
        # nor does what another viewer does take it away
        other.say(do="set", shape="wedge", values={"impactor.velocity": 4, "impactor.mass": 9})
        page.until(lambda: page["#impactor-mass"].get_property("value") == "9")
        field = type_in(page, "impactor-velocity", "600")
        page["#impactor-mass"].click()
        assert field.get_property("value") == "600"
        # a message from the page after all of it: it has sent no drop before
        page["#grid"].click()
        other.see(lambda last: not last["settings"]["grid"])
        assert other.last["scene"]["drop"] == before
        page["#grid"].click()
        page["#reset"].click()
        page.until(lambda: field.get_property("value") == "2.86")
        assert field.get_attribute("aria-invalid") == "false"


_WHY = {
    "abc": " is not a number",
    "0x3": " is not a number",
    "Infinity": " is not a number",
    "1,000": " could mean 1000 or 1.000; write the one you mean",
    "1.000,5": " has thousands separators; leave them out",
    "1,000.5": " has thousands separators; leave them out",
}


def test_what_is_typed_is_what_drops(page: Page, server: Served) -> None:
    page["#pace"].send_keys("fastest")
    typed = {"3,3": 3.3, "2.8612345678": 2.8612345678, "0,125": 0.125, ".5": 0.5, "1e-1": 0.1}
    with server.viewer(watches=False) as other:
        for text, velocity in typed.items():
            field = type_in(page, "impactor-velocity", text)
            page["#drop"].click()  # at once, with no Enter or Tab before
            told = other.see(
                lambda last, v=velocity: last["scene"]["name"] == f"wedge, {v:.6g} m/s"
            )
            assert told["settings"]["values"]["impactor.velocity"] == velocity
            page.until(lambda v=velocity, f=field: f.get_property("value") == str(v))
            page.until(lambda v=velocity: page.text("#name") == f"wedge, {v:.6g} m/s")
        other.see(lambda last: last["numbers"]["state"] == "ended")
        about = "velocity 0.1 m/s"
        other.see(lambda last: last["drops"]["drops"][0]["about"] == [about])
        folder = other.see(lambda last: last["drops"]["drops"][0]["folder"])["drops"]["drops"][0]
    scene = Result.load(Path(folder["folder"])).scene
    assert scene.impactor is not None
    assert (scene.impactor.velocity, scene.name) == (0.1, "wedge, 0.1 m/s")
    page["#reset"].click()


def test_who_types_is_not_disturbed_and_others_follow(page: Page, server: Served) -> None:
    mass = page["#impactor-mass"]
    mass.send_keys(Keys.CONTROL, "a", Keys.NULL, "7")
    with server.viewer(watches=False) as other:
        both = {"impactor.mass": 9, "impactor.friction": 0.5}
        other.say(do="set", shape="wedge", values=both)
        page.until(lambda: page["#impactor-friction"].get_property("value") == "0.5")
        assert page.ask("document.activeElement.id") == "impactor-mass"
        assert page["#impactor-mass"].get_property("value") == "7"
        mass.send_keys(".5", Keys.TAB)
        other.see(lambda last: last["settings"]["values"]["impactor.mass"] == 7.5)


def test_pause_and_step(page: Page) -> None:
    page["#pace"].send_keys("1 : 1,000")
    page["#reset"].click()
    page.until(lambda: page.text("#state") == "running")
    page["#pause"].click()
    page.until(lambda: page.text("#state") == "paused")
    page.until(lambda: page["#pause"].text == "Resume")
    before = float(page.text("#time"))
    page["#step"].click()
    # 0.2 ms from row to row of the history, either of them up to 0.013 ms late and rounded to 0.01
    page.until(lambda: float(page.text("#time")) > before + 0.17)
    page.until(lambda: page.text("#state") == "paused")
    assert float(page.text("#time")) < before + 0.4
    page["#pause"].click()
    page.until(lambda: page.text("#state") == "running")


def test_key_figures_are_grey_while_they_are_older_than_the_picture(page: Page) -> None:
    page["#pace"].send_keys("1 : 100")
    page["#reset"].click()
    page.until(lambda: page.text("#state") == "running" and float(page.text("#time")) > 7.0)
    page["#pace"].send_keys("1 : 500")  # it sinks for 20 s more: a busy machine takes its time
    stale = "document.getElementById('figures').classList.contains('stale')"
    page.until(lambda: float(page.text("#time")) > 8.0)  # it has touched by then
    page.until(lambda: page.ask(stale))
    assert page["#figures"].get_attribute("aria-describedby") == "figures-time"
    assert re.fullmatch(r"at t = [\d.]+ ms", page.text("#figures-time"))
    page["#pause"].click()
    page.until(lambda: page.text("#state") == "paused")
    # a busy browser may draw the picture of that rest after it has been told the figures
    page.until(lambda: page.text("#figures-time") == f"at t = {page.text('#time')} ms")
    assert not page.ask(stale)
    assert page.figure("displacement") == page.text("#displacement")
    page["#pause"].click()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_it_fits_a_phone(page: Page, scheme: str) -> None:
    page["#pace"].send_keys("fastest")  # a drop that is over belongs to what has to fit
    page.width(360, 740, scheme)
    page.until(lambda: page.ask("document.documentElement.dataset.theme") == scheme)
    page.until(lambda: page.drop() > 0)
    page.ask("document.querySelectorAll('#groups details').forEach((e) => { e.open = true; })")
    page.until(lambda: page.ask("document.querySelector('#curve svg')?.clientWidth") <= 360)
    assert page.ask("document.documentElement.scrollWidth") <= 360
    touched = "button, select, input, summary, #shapes label, #list a"
    sizes = page.ask(
        "[...document.querySelectorAll(arguments[0])].filter((e) => e.checkVisibility())"
        ".map((e) => [e.id || e.textContent || e.type, (e.closest('label') ?? e)"
        ".getBoundingClientRect().height])",
        touched,
    )
    assert len(sizes) > 20
    assert [size for size in sizes if size[1] < 43.5] == []


def test_nothing_is_without_a_name_for_those_who_do_not_see(page: Page) -> None:
    nameless = page.ask(
        "[...document.querySelectorAll('input, select, button, canvas')].filter((e) =>"
        " !e.labels?.length && !e.getAttribute('aria-label') && !e.textContent.trim())"
        ".map((e) => e.outerHTML)"
    )
    assert nameless == []
    assert page["#state"].get_attribute("aria-live") == "polite"


def test_sliders_and_the_curve_say_what_they_show(page: Page) -> None:
    page["#reset"].click()

    def spoken(key: str) -> str | None:
        return page[f"#{key} ~ input[type=range]"].get_attribute("aria-valuetext")

    page.until(lambda: spoken("impactor-velocity") == "2.86 m/s")
    modulus = page.ask("document.getElementById('foam-youngs_modulus').value")
    assert spoken("foam-youngs_modulus") == f"{modulus} MPa"  # its slider goes from 0 to 1000
    curve = page["#curve"]
    assert curve.get_attribute("role") == "img"
    page.until(lambda: "measured plateau 66 m/s²" in (curve.get_attribute("aria-label") or ""))
    assert re.search(r": -?[\d.]+ m/s² at [\d.]+ ms, at most", curve.get_attribute("aria-label"))


def test_picture_and_curve_share_the_first_screen(page: Page) -> None:
    box = "(({left, right, top, bottom}) => [right - left, top, bottom])"
    places = f"{box}(document.querySelector(arguments[0]).getBoundingClientRect())"
    for height in (740, 900):
        page.width(1280, height)
        page.until(lambda height=height: page.ask("window.innerHeight") == height)
        shape = page.ask(
            "(({width, height}) => width / height)(document.getElementById('picture'))"
        )
        # as wide as its card, unless that takes more than 45 % of the height
        width, top, bottom = page.ask(places, "#picture")
        assert bottom - top == pytest.approx(min(0.45 * height, width / shape), abs=2)
        _, curve_top, curve_bottom = page.ask(places, "#curve")
        assert (curve_top if height == 740 else curve_bottom) < height


# where a point of the cushion chart is, in CSS pixels from the corner of the window
_PLACE = """((gd, n) => {
  const { xaxis, yaxis } = gd._fullLayout, { x, y } = gd.data[1];
  const { left, top } = gd.getBoundingClientRect();
  return [left + xaxis._offset + xaxis.d2p(x[n]), top + yaxis._offset + yaxis.d2p(y[n])];
})(document.getElementById("chart-plot"), 0)"""


def test_a_point_of_the_cushion_chart_is_watched(browser: Chrome, tmp_path: Path) -> None:
    # the served drop has the kernels that drops on cushions need
    flat = ("impactor.shape=flat", *SMALL)
    with Served(tmp_path, *flat) as server:
        page = Page(browser, server.address)
        page.width(1280, 900)
        page.until(lambda: page.text("#state") not in ("connecting", "preparing"))
        served = page.text("#name")
        page["#pace"].send_keys("fastest")
        page["#run-tab"].send_keys(Keys.ARROW_RIGHT)
        assert page.ask("document.activeElement.id") == "cushion-tab"
        assert not page["#picture"].is_displayed()

        for key, wrong, words in (
            ("thickness", "0", "0: must be 5 to 300 mm"),
            ("foam", "granite", "'granite': must be of this scene, or in the library"),
        ):
            field = page[f"#cushion-{key}"]
            before = field.get_property("value")
            field.send_keys(Keys.CONTROL, "a", Keys.NULL, wrong, Keys.ENTER)
            beside = f"#cushion-{key}-wrong"
            page.until(lambda beside=beside, words=words: words in page.text(beside))
            assert not page["#points"].is_displayed()
            field.send_keys(Keys.CONTROL, "a", Keys.NULL, before)
        pasted = page["#cushion-tests"]
        pasted.send_keys("76,50,5.2,41")
        page["#ask-chart"].click()
        page.until(lambda: "own tests: has no header" in page.text("#cushion-tests-wrong"))
        head = "height [cm],thickness [mm],static stress [kPa],peak [g]"
        pasted.send_keys(Keys.CONTROL, Keys.HOME, Keys.NULL, head, Keys.ENTER)
        page["#ask-chart"].click()
        page.until(
            lambda: page.ask("document.getElementById('chart-plot').data?.[0].y.length > 50")
        )
        assert page.ask("document.getElementById('chart-plot').data.at(-1).y") == [41.0]
        assert "1 of 1 own tests have this drop height" in page.text("#chart-state")
        page.until(lambda: page.ask("document.getElementById('chart-plot').data[1].x.length > 0"))
        peak = page.ask("document.getElementById('chart-plot').data[1].y[0]")
        assert page.text("#points-table tbody td:nth-child(3)") == f"{peak:.1f}"
        assert page.errors() == []

        def clicked() -> bool:
            """Points move up and down while others come and the axis grows: a click may miss."""
            x, y = page.ask(_PLACE)
            pointer = ActionChains(browser)
            pointer.w3c_actions.pointer_action.move_to_location(round(x), round(y))
            pointer.click().perform()
            return page["#picture"].is_displayed()

        page.until(clicked)
        page.until(
            lambda: page.text("#name").startswith("cushion, foam of paper/wedge-2.86, 50 mm")
        )
        assert page["#apart"].is_displayed()
        page.until(lambda: page.text("#state") == "ended")
        # figures come after the last picture
        page.until(lambda: page.figure("raw peak g") == f"{peak:.1f}")
        page.until(lambda: "cushion" in page.text("#list tbody tr:first-child td:nth-child(2)"))

        page["#reset"].click()
        page.until(lambda: page.text("#name") == served)
        assert not page["#apart"].is_displayed()
        page["#run-tab"].send_keys(Keys.ARROW_RIGHT)  # a click may miss while the name changes
        page.until(lambda: page["#points-table [data-point='0']"].is_displayed())
        watch = page["#points-table [data-point='0']"]
        assert watch.get_attribute("aria-label").startswith("Watch the drop at ")
        watch.send_keys(Keys.ENTER)
        page.until(lambda: page.text("#name").startswith("cushion"))
        assert page["#picture"].is_displayed()
        assert page.errors() == []


def test_a_page_whose_server_has_gone_tells_so_and_that_the_token_of_the_next_is_new(
    browser: Chrome, tmp_path: Path
) -> None:
    """What is dropped meanwhile is told and stays in its field."""
    everywhere = ("--host", "0.0.0.0")
    with Served(tmp_path, *SMALL, options=everywhere) as old:
        token = old.address.partition("?")[2]
        page = Page(browser, f"http://127.0.0.1:{old.port}/?{token}")
        page.until(lambda: page.text("#state") in ("running", "ended"))
        old.kill()
    page.until(lambda: "connection lost" in page.text("#state"))
    assert not page["#pause"].is_enabled()
    for button in ("#drop", "#reset"):
        field = type_in(page, "impactor-velocity", "3.3")
        page[button].click()
        page.until(lambda: "the page has no connection" in page.text("#problem"))
        assert page["#problem"].is_displayed()
        assert field.get_property("value") == "3.3"
        page.ask("document.getElementById('problem').replaceChildren()")
    with Served(tmp_path, *SMALL, options=(*everywhere, "--port", str(old.port))) as new:
        page.until(lambda: "open the address that it printed" in page.text("#state"))
        new.kill()
    browser.get_log("browser")  # the lost connection is no fault of later pages
