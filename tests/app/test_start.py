"""The start of the page, and results that are not those of today's inputs."""

from __future__ import annotations

import asyncio
import dataclasses
import json
from types import SimpleNamespace

import pytest

pytest.importorskip("nicegui")

import softmodels as sm
from measurement.series.photo_list import Column
from softmodels.app import device, forms, jobs, making, photographs, start
from softmodels.app.bench import CASE, OUTLINES, PHOTOS, Project
from softmodels.app.jobs import DONE, Job, Jobs, check_command
from softmodels.case.case import Case
from softmodels.case.load import steps_of
from softmodels.casting import settings
from softmodels.common import schema
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


def commands(project):
    """What each button of the page starts, with choices other than the defaults."""
    page = {"project": project, "bench": SimpleNamespace(photographs=SimpleNamespace(measured={"a.jpg": {"trusted": "no"}}))}
    listed = SimpleNamespace(setup="x", project=project, column=Column(998.0), tone="linear", write_list=lambda: None)
    workshop = schema.about(settings.Workshop)
    design = making.DesignPage.__new__(making.DesignPage)
    vars(design).update(
        project=project, varied=box(["wall"]), reach=box("1.5"), objective=box("most rise"), probe=box("apex"),
        at=box("60 cm"), limits={name: box("1.25") for name in making.LIMITS},
    )  # fmt: skip
    material = {"with_outlines": box(True), "tests": {"pull.csv": box("uniaxial")}, "laws": box(["yeoh", "gent"])}
    numbers = {"poisson": box("0.49"), "product": box("ecoflex-00-30"), "fixed": box("c3=0, leak=0")}
    mould = {"silicone": box("dragon-skin-30"), "settings": {name: box("1 mm") for name in workshop}}
    return [
        photographs.PhotographsPage._calibrate(SimpleNamespace(**page, pattern=box("9x6"), square=box("25mm"))),
        photographs.PhotographsPage._measure(SimpleNamespace(photos=listed, handles=SimpleNamespace(zero=None))),
        making.MaterialPage._command(SimpleNamespace(**page, **material, **numbers)),
        device.DevicePage._run(SimpleNamespace(**page)),
        making.MouldPage._command(SimpleNamespace(**page, **mould)),
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


CHANGES = {
    "pressure": ({"device"}, lambda project: project.change(steps=steps_of(pressure="0:40 cm"))),
    "material": ({"device", "mould", "design"}, lambda project: project.change(material=sm.Yeoh(12e3, 0.0))),
    "length": (
        {"fit", "device", "mould", "design"},
        lambda project: project.change(actuator=project.case.actuator.replaced(membrane="5 mm")),
    ),
    "outlines": ({"fit"}, lambda project: (project / OUTLINES / "a.csv").write_text("x,z\n0,1\n")),
    "curve": ({"fit"}, lambda project: (project / "curves" / "pull.csv").write_text("stretch,stress\n1,1\n")),
    "photograph": ({"outlines"}, lambda project: (project / "photographs" / "a.jpg").write_bytes(b"y")),
    "entry of the list": (
        {"outlines"},
        lambda project: (project / PHOTOS).write_text("file,pressure,use\na.jpg,0 cm,anyway\n"),
    ),
    "board": ({"lens.toml"}, lambda project: (project / "boards" / "a.jpg").write_bytes(b"y")),
    "nothing": (set(), lambda project: (project / CASE).touch()),
}


@pytest.mark.parametrize("what", CHANGES)
def test_what_depends_on_a_change_is_out_of_date_and_nothing_else(what, project):
    known = Jobs(project.folder)
    bench = SimpleNamespace(project=project, jobs=known)
    before = {command.output: done(project, command) for command in commands(project)}
    assert not any(forms.is_outdated(bench, job) for job in before.values())
    wanted, change = CHANGES[what]
    change(project)
    now = {command.output: command for command in commands(project)}
    outdated = {output for output, job in before.items() if forms.is_outdated(bench, job, now[output])}
    assert {output.rpartition("/")[2] for output in outdated} == wanted


@pytest.mark.parametrize("what", ["length", "material", "pressure"])
def test_the_start_says_the_same_as_the_pages(what, project):
    """It does not know the commands that the pages would start."""
    bench = SimpleNamespace(project=project, jobs=Jobs(project.folder))
    before = {command.output: done(project, command) for command in commands(project)}
    wanted, change = CHANGES[what]
    change(project)
    assert {output.rpartition("/")[2] for output, job in before.items() if forms.is_outdated(bench, job)} == wanted


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
    bench, job = SimpleNamespace(project=project, jobs=known), done(project, command)
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
