"""The start of the page, and results that are not those of today's inputs."""

from __future__ import annotations

import asyncio
import dataclasses
import functools
import json
from types import SimpleNamespace

import pytest

pytest.importorskip("nicegui")

import softmodels as sm
from measurement.series.photo_list import Column
from softmodels.app import device, forms, jobs, making, photographs, start
from softmodels.app.bench import CASE, OUTLINES, PHOTOS, Project
from softmodels.app.jobs import DONE, Job, Jobs, check_command
from softmodels.case import materials
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.casting import settings
from softmodels.common import schema
from softmodels.materials import silicones
from tests.app.conftest import served, tab, value


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch):
    """A user's own folder for the key."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.fixture
def project(tmp_path):
    """A project with files of every kind."""
    made = Project(tmp_path / "project")
    made.change(water_density=998.0)
    for name in ("boards/grid.jpg", "boards/a.jpg", "photographs/a.jpg", "setup.toml"):
        (made / name).write_bytes(b"x")
    (made / OUTLINES).mkdir()
    (made / "curves" / "pull.csv").write_text("stretch,stress\n1,0\n")
    (made / PHOTOS).write_text("file,pressure\nphotographs/a.jpg,0 cm\n")
    return made


def box(text):
    return SimpleNamespace(value=text)


CHOICES = {
    "pattern": "9x6", "square": "25mm", "tone": "linear", "with_outlines": True, "tests": {"pull.csv": box("uniaxial")},
    "laws": ["yeoh", "gent"], "poisson": "0.49", "product": "ecoflex-00-30", "fixed": "c3=0, leak=0",
    "silicone": "dragon-skin-30", "settings": {name: box("1 mm") for name in schema.about(settings.Workshop)},
    "varied": ["wall"], "reach": "1.5", "objective": "most rise", "probe": "apex", "at": "60 cm",
    "limits": {name: box("1.25") for name in making.LIMITS},
}  # fmt: skip
"""Other than the defaults."""


def commands(project, **choices):
    """What each button of the page starts."""
    made = {name: value if isinstance(value, dict) else box(value) for name, value in {**CHOICES, **choices}.items()}
    density = project.case.water_density
    listed = SimpleNamespace(
        setup="x", project=project, column=Column(density), tone=made["tone"].value, write_list=lambda: None
    )
    measured = SimpleNamespace(measured={"a.jpg": {"trusted": "no"}})
    page = SimpleNamespace(
        project=project, bench=SimpleNamespace(photographs=measured), photos=listed, handles=SimpleNamespace(zero=[1]), **made
    )
    design = making.DesignPage.__new__(making.DesignPage)
    vars(design).update(vars(page))
    return [
        photographs.PhotographsPage._calibrate(page),
        photographs.PhotographsPage._measure(page),
        making.MaterialPage._command(page),
        device.DevicePage._run(page),
        making.MouldPage._command(page),
        design._command(),
    ]


def test_what_the_buttons_start_is_a_command_of_the_page(project):
    """A calibration and a liquid of one's own were refused once."""
    found = commands(project)
    for command in found:
        check_command(command.words, project.folder)
    assert {" ".join(command.words[:2]) for command in found} == set(jobs.COMMANDS)
    words = [word for command in found for word in command.words]
    used = {option for option in {o for known in jobs.COMMANDS.values() for o in known} if option in words}
    assert used == {option for known in jobs.COMMANDS.values() for option in known}


def done(project, command):
    """A job that was started with a command and is done."""
    for name, text in command.written.items():
        (project / name).write_text(text)
    return Job(1, [*command.words], command.output, state=DONE, inputs=jobs.digest(command.words, project.folder))


def case(**fields):
    return lambda project: project.change(**fields)


def field(**values):
    return lambda project: project.change(actuator=project.case.actuator.replaced(**values))


def text(name, content):
    return lambda project: (project / name).write_text(content)


def gone(name):
    return lambda project: (project / name).unlink()


def choice(**choices):
    return lambda project: choices


SHAPE = {"fit", "device", "mould", "design"}
LISTED = "file,pressure,use\nphotographs/a.jpg,"
CHANGES = {
    "pressure": ({"device"}, case(steps=steps_of(pressure="0:40 cm"))),
    "volume instead": ({"device"}, case(steps=steps_of(volume_ml="0:2"))),
    "syringe": ({"device", "design"}, case(control="volume")),
    "material": ({"device", "mould", "design"}, case(material=sm.Yeoh(12e3, 0.0))),
    "silicone": ({"device", "mould", "design"}, case(material=silicones.silicone("dragon-skin-30"))),
    "its band": ({"device"}, case(band=materials.SourceBand("ecoflex-00-30"))),
    "liquid": ({"device", "outlines", "design"}, case(water_density=1000.0)),
    "membrane": (SHAPE, field(membrane="5 mm")),
    "wall": (SHAPE, field(wall="12 mm")),
    "base": (SHAPE, field(base="5 mm")),
    "fillet": (SHAPE, field(fillet="0.5 mm")),
    "cavity": (SHAPE, field(cavity_radius="11 mm")),
    "its height": (SHAPE, field(cavity_height="5 mm")),
    "another device": (SHAPE, case(actuator=sm.Balloon())),
    "an outline": ({"fit"}, text(f"{OUTLINES}/a.csv", "x,z\n0,1\n")),
    "heights": ({"fit"}, text(f"{OUTLINES}/heights.csv", "file\na.jpg\n")),
    "curve": ({"fit"}, text("curves/pull.csv", "stretch,stress\n1,1\n")),
    "curve taken away": ({"fit"}, gone("curves/pull.csv")),
    "curve that is not used": (set(), text("curves/other.csv", "stretch,stress\n1,1\n")),
    "photograph": ({"outlines"}, text("photographs/a.jpg", "y")),
    "photograph taken away": ({"outlines"}, gone("photographs/a.jpg")),
    "photograph that is not listed": (set(), text("photographs/b.jpg", "y")),
    "its pressure": ({"outlines"}, text(PHOTOS, f"{LISTED}1 cm,\n")),
    "its use": ({"outlines"}, text(PHOTOS, f"{LISTED}0 cm,anyway\n")),
    "screen": ({"outlines"}, text("setup.toml", "y")),
    "tone": ({"outlines"}, choice(tone="srgb")),
    "board": ({"lens.toml"}, text("boards/a.jpg", "y")),
    "board taken away": ({"lens.toml"}, gone("boards/a.jpg")),
    "another board": ({"lens.toml"}, text("boards/b.jpg", "y")),
    "corners of the board": ({"lens.toml"}, choice(pattern="8x5")),
    "its squares": ({"lens.toml"}, choice(square="20mm")),
    "laws": ({"fit"}, choice(laws=["gent"])),
    "Poisson's ratio": ({"fit"}, choice(poisson="0.5")),
    "fixed parameters": ({"fit"}, choice(fixed="")),
    "kind of curve": ({"fit"}, choice(tests={"pull.csv": box("planar")})),
    "silicone to cast": ({"mould"}, choice(silicone="as simulated")),
    "tube": ({"mould"}, choice(settings={"tube": box("3 mm")})),
    "lengths that may change": ({"design"}, choice(varied=["membrane"])),
    "by how much": ({"design"}, choice(reach="1.2")),
    "objective": ({"design"}, choice(objective="least silicone")),
    "limits": ({"design"}, choice(limits={})),
    "pressure of the design": ({"design"}, choice(at="50 cm")),
    "nothing": (set(), lambda project: [(project / name).touch() for name in (CASE, PHOTOS, "photographs/a.jpg")]),
}


@pytest.mark.parametrize("what", CHANGES)
def test_what_depends_on_a_change_is_out_of_date_and_nothing_else(what, project):
    """So say the pages, and the start, which knows what they would start."""
    bench = SimpleNamespace(project=project, jobs=Jobs(project.folder), commands={})
    before = {command.output: done(project, command) for command in commands(project)}
    assert not any(forms.is_outdated(bench, job) for job in before.values())
    wanted, change = CHANGES[what]
    choices = change(project)
    now = {command.output: command for command in commands(project, **(choices if isinstance(choices, dict) else {}))}
    pages = {output for output, job in before.items() if forms.is_outdated(bench, job, now[output])}
    bench.commands = {output: functools.partial(now.get, output) for output in now}
    start_page = {output for output, job in before.items() if forms.is_outdated(bench, job)}
    assert {output.rpartition("/")[2] for output in pages} == wanted and start_page == pages


FOREIGN_WORDS = ["softmodels", "fit", "case.toml", "--material", "nosuch", "--poisson", "0.4", "--poisson", "x", "--silicone",
                 "nosuch", "--tensile", "curves/pull.csv:nosuch", "-o", "results/fit"]  # fmt: skip
FOREIGN_PROBLEM = (
    "case = 'design-case.toml'\nparameters = 3\n", "case = 'design-case.toml'\nkeep = [1]\n[parameters.wall]\nfrom = 'x'\n",
    "case = 'design-case.toml'\n[parameters]\n", "case = [", "case = 'design-case.toml'\n[maximise]\nquantity = 'rise'\n",
)  # fmt: skip


@pytest.mark.parametrize("problem", FOREIGN_PROBLEM)
def test_a_problem_of_another_shape_is_none(problem, tmp_path):
    (tmp_path / "problem.toml").write_text(problem)
    assert making.last_problem(tmp_path / "problem.toml") is None


def test_the_last_problem_is_what_was_asked(project):
    command = commands(project)[-1]
    (project / making.PROBLEM).write_text(command.written[making.PROBLEM])
    last = making.last_problem(project / making.PROBLEM)
    assert (last.lengths, last.objective, last.of, last.at) == (["wall"], "most rise", "apex", "60 cm")
    assert last.factor == pytest.approx(1.5)
    assert last.limits == {quantity: "1.25" for quantity, _ in making.LIMITS.values()}


@pytest.mark.campaign
def test_choices_of_a_foreign_project_do_not_break_the_page(browser, tmp_path):
    project = tmp_path / "project"
    (project / "jobs").mkdir(parents=True)
    (project / "curves").mkdir()
    (project / "curves" / "pull.csv").write_text("stretch,stress\n1,0\n")
    (project / "problem.toml").write_text(FOREIGN_PROBLEM[1])
    mould = ["softmodels", "mould", "x", "--silicone", "nosuch", "--tube", "1 mm", "--tube", "2 mm"]
    for number, words in enumerate((FOREIGN_WORDS, mould), 1):
        record = {"number": number, "words": words, "output": f"results/{words[1]}", "resumable": False, "state": DONE}
        (project / "jobs" / f"{number}.json").write_text(json.dumps(record))
    with served(project) as (_, address), tab(browser, address, "Mould") as page:
        page.get_by_role("button", name="Make the mould").wait_for()
        page.get_by_role("tab", name="Material").click()
        assert page.locator('input[data-name="poisson"]').input_value() == "0.4"


def test_another_choice_puts_results_out_of_date(project):
    known, command = Jobs(project.folder), commands(project)[2]
    bench, job = SimpleNamespace(project=project, jobs=known, commands={}), done(project, command)
    other = dataclasses.replace(command, words=["gent" if word == "yeoh,gent" else word for word in command.words])
    assert not forms.is_outdated(bench, job, command) and forms.is_outdated(bench, job, other)
    job.words.append(jobs.RESUME)
    assert not forms.is_outdated(bench, job, command)
    for state in (jobs.FAILED, jobs.STOPPED, jobs.RUNNING):
        assert not forms.is_outdated(bench, dataclasses.replace(job, state=state), other)


@pytest.mark.campaign
def test_samples_fill_a_project_and_are_measured(browser, tmp_path):
    """From one click to the outlines of the sample photographs."""
    with served(tmp_path / "project") as (_, address), tab(browser, address, "Start") as page:
        samples = page.get_by_role("button", name="Try it with sample photographs")
        samples.click()
        page.get_by_text("filling this project").wait_for()
        with tab(browser, address, "Start") as other:
            for shown in (page, other):
                assert shown.get_by_role("button", name="Try it with sample photographs").is_disabled()
        page.wait_for_function("document.querySelector('[data-name=\"start-told\"]')?.textContent.startsWith('filled')")
        assert samples.is_enabled() and not page.get_by_text("filling this project").is_visible()
        page.get_by_role("tab", name="Photographs").click()
        page.get_by_role("button", name="Measure all outlines").click()
        page.wait_for_function("document.querySelector('[data-name=\"state-outlines\"]')?.textContent == 'done'")
        page.get_by_role("tab", name="Start").click()
        assert value(page, "step-Photographs") == DONE
        assert page.get_by_text("10 measured, 10 trusted").count() == 1
        page.get_by_role("button", name="Try it with sample photographs").click()
        page.get_by_text("this project has photographs already").wait_for()


@pytest.mark.campaign
def test_a_part_is_dropped_and_becomes_the_device(browser, tmp_path):
    from softmodels.app.bench import SAMPLES

    project = tmp_path / "project"
    with served(project) as (_, address), tab(browser, address, "Start") as page:
        page.get_by_text("My own part").click()
        page.locator('[data-name="part"] input[type=file]').set_input_files(SAMPLES / "made" / "mypart.step")
        page.get_by_text("this device is a solid").wait_for()
    assert type(Case.from_file(project / CASE).actuator).__name__ == "ImportedActuator"


LEAF = (
    '<svg xmlns="http://www.w3.org/2000/svg" width="50mm" height="24mm" viewBox="0 0 50 24"><g fill="none" stroke="#000080">'
    '<path d="M0 0H50V24H0Z" stroke="#444" stroke-width="0.2"/><path d="M6 12H42M18 12L26 5M18 12L26 19" stroke-width="2.4"/>'
    "</g></svg>"
)
GIVEN = {
    "leaf.svg": (LEAF, "ChannelPlate", ""),
    "broken.svg": ("<svg", "HollowDisk", "broken.svg: "),
    "part.stl": ("no part", "HollowDisk", "part.stl: "),
}


@pytest.mark.parametrize("name", GIVEN)
def test_a_dropped_file_becomes_the_device_or_says_why_not(name, project):
    text, device_name, told = GIVEN[name]
    said = []

    async def data():
        return text.encode()

    page = start.StartPage.__new__(start.StartPage)
    vars(page).update(project=project, support=box("x = 0 mm"), go=said.append, say=said.append)
    asyncio.run(page._part(SimpleNamespace(files=[SimpleNamespace(name=name, read=data)])))
    assert type(project.case.actuator).__name__ == device_name and said[0].startswith(told or "Device")
    assert [file.name for file in (project / "parts").iterdir()] == ([] if told else [name])
    before = project.case.actuator.digest()
    moved = Project(project.folder.rename(project.folder.with_name("moved")))
    assert not moved.case_error and moved.case.actuator.digest() == before
