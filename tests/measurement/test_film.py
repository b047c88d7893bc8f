"""Films of a bar that bends and a log of its pressure: clocks, plateaus, photographs, and what is doubted."""

from __future__ import annotations

import csv
import dataclasses

import numpy as np
import pytest
from click.testing import CliRunner

from measurement import film
from measurement.camera import Camera
from measurement.cli.setup import setup as setup_command
from measurement.cli.views import view as view_command
from measurement.screen.setup import Setup, plane_of_scale
from measurement.series import photo_list, views
from tests.support import films

PROGRAM = films.Program()
OFFSET = 41.237


@pytest.fixture(scope="module")
def taken(tmp_path_factory):
    """A folder with a film in MP4, and how fast its picture changes."""
    folder = tmp_path_factory.mktemp("film")
    films.film(folder / "finger.mp4", PROGRAM)
    return folder, film.motion_of(folder / "finger.mp4")


def scene():
    camera = Camera.ideal(*films.SIZE)
    known = Setup(camera, plane_of_scale(camera, 1.0 / films.PIXEL, 1.0))
    return views.Scene(known, (2.0, 1e-3), (0.0, 0.0), (0.0, 1e-4), films.BASE, (films.LENGTH, 1e-4))


def logged(folder, **how):
    films.log(folder / "log.csv", **{"offset": OFFSET, **how})
    return film.read_log(folder / "log.csv")


@pytest.mark.parametrize("step", [0.1, 0.02, 0.5])
def test_clocks_are_aligned_within_a_frame(taken, tmp_path, step):
    clocks = film.align(taken[1], logged(tmp_path, step=step, seed=round(1e3 * step)))
    film.check_clocks(clocks, given=False)
    assert abs(clocks.offset - OFFSET) < taken[1].step


def test_log_of_a_part_of_the_film_is_aligned(taken, tmp_path):
    clocks = film.align(taken[1], logged(tmp_path, begin=3.0, end=10.5))
    assert abs(clocks.offset - OFFSET) < taken[1].step


def test_plateaus_are_found_within_a_frame(taken, tmp_path):
    for log in (None, logged(tmp_path)):
        held = film.plateaus(taken[1], log, OFFSET)
        misses = np.array([(a.begin - b[0], a.end - b[1]) for a, b in zip(held, PROGRAM.plateaus, strict=True)])
        assert np.abs(misses).max() < 1.01 * taken[1].step


def test_avi_of_another_rate_is_read(tmp_path):
    films.film(tmp_path / "finger.avi", dataclasses.replace(PROGRAM, until=6.0), fps=15.0, code="MJPG")
    motion = film.motion_of(tmp_path / "finger.avi")
    assert motion.times == pytest.approx(np.arange(90) / 15.0, abs=1e-6)
    assert abs(film.align(motion, logged(tmp_path)).offset - OFFSET) < motion.step


def test_photographs_show_the_bar_at_its_pressures(taken, tmp_path):
    folder, motion = taken
    log = logged(tmp_path)
    held = film.plateaus(motion, log, OFFSET)
    shots = film.shots_of(motion, held, lambda number, first, last: film.logged(log, first + OFFSET, last + OFFSET, 50.0))
    film.write_shots(folder / "finger.mp4", shots, tmp_path)
    listed = photo_list.read_photos(tmp_path / film.LIST)
    assert [photo.pressure for photo in listed] == pytest.approx(PROGRAM.levels, abs=30.0)
    made = views.views(listed, scene())
    assert [view.trust for view in made.outcomes] == ["yes"] * len(listed)
    for view, level in zip(made.views, PROGRAM.levels, strict=True):
        away = view.shape.tip - made.origin - films.tip_at(level)
        assert np.linalg.norm(away) < 1.5e-4
        assert (np.abs(away) < 3.5 * view.tip_error).all()
    *_, last = listed
    times = np.array([time for time, _ in last.history])
    corners = [time for begin in PROGRAM.begins[1:] for time in (begin, begin + PROGRAM.takes)]
    near = np.abs(times[:, None] + PROGRAM.begins[1] - corners).min(axis=0)
    assert near.max() < 2.02 * motion.step
    assert (np.diff(times) > 0.0).all()


def arguments(folder, *words):
    known = scene().setup
    (folder / "setup.toml").write_text(known.to_toml())
    base = "=".join(f"{x},{y}" for x, y in films.BASE)
    return ["--setup", str(folder / "setup.toml"), "--depth", "0", "--camera-distance", "2m", "--ahead", "0+-0.1mm",
            "--base", base, "-o", str(folder / "views"), *words]  # fmt: skip


@pytest.mark.campaign
def test_command_measures_a_film_with_typed_pressures_and_again_from_its_frames(taken, tmp_path, monkeypatch):
    run, file = CliRunner(), str(taken[0] / "finger.mp4")
    few = run.invoke(view_command, [file, *arguments(tmp_path, "--pressures", "0, 8, 16 kPa")])
    assert (few.exit_code, "5 plateaus (0.0-2.0 s" in few.output) == (2, True), few.output
    assert "--pressures" in run.invoke(view_command, [file, *arguments(tmp_path)]).output
    words = [file, *arguments(tmp_path, "--pressures", "0, 8, 16, 11, 24 kPa", "--quiet")]
    result = run.invoke(view_command, words)
    assert result.exit_code == 0, result.output
    with (tmp_path / "views" / "views.csv").open() as table:
        rows = list(csv.DictReader(table))
    assert [float(row["pressure_Pa"]) for row in rows] == pytest.approx(PROGRAM.levels)
    assert all(a < float(row["time_s"]) < b for row, (a, b) in zip(rows, PROGRAM.plateaus, strict=True))
    for row, level in zip(rows, PROGRAM.levels, strict=True):
        assert [float(row["tip_x_m"]), float(row["tip_z_m"])] == pytest.approx(films.tip_at(level), abs=1.5e-4)
    assert len(list(film.frames(tmp_path / "views" / "film.mp4"))) == len(rows)
    monkeypatch.setattr(film, "motion_of", None)  # the frames are there
    assert run.invoke(view_command, words).exit_code == 0


@pytest.mark.campaign
def test_command_makes_a_history_in_time(taken, tmp_path):
    films.log(tmp_path / "log.csv", offset=OFFSET)
    words = ["--pressures", str(tmp_path / "log.csv"), "--every", "0.5s", "--no-pictures"]
    result = CliRunner().invoke(view_command, [str(taken[0] / "finger.mp4"), *arguments(tmp_path, *words)])
    assert "the film begins at 41.2" in result.output
    with (tmp_path / "views" / "views.csv").open() as table:
        rows = list(csv.DictReader(table))
    assert len(rows) == 24
    good = [row for row in rows if row["trusted"] == "yes"]
    assert len(good) > 18
    for row in good:
        true = films.tip_at(PROGRAM.pressure(float(row["time_s"])))
        assert np.hypot(float(row["tip_x_m"]) - true[0], float(row["tip_z_m"]) - true[1]) < 6e-4


def test_frames_of_one_pressure_are_one_hold():
    """A step of 0.8 s between the frames at 8 and 12 s of the log's clock, and a fall in which single frames are taken."""
    at = np.arange(0.0, 60.0, 0.1)
    pressures = np.interp(at, [0.0, 10.0, 10.8, 30.0, 45.0], [0.0, 0.0, 5e3, 5e3, 0.0])
    log = film.Log(at, pressures + np.random.default_rng(0).normal(0.0, 5.0, len(at)))
    motion = film.Motion(np.arange(0.0, 32.0, 0.04), np.zeros(800), 0.1, 1.0)
    rest, *held = film.history_of(motion, log, 6.0, 4.0, None)
    assert [shot.time for shot in held] == pytest.approx([4.0 * k for k in range(1, 8)])
    assert abs(rest.pressure) < 20.0
    assert [shot.pressure for shot in held[1:6]] == pytest.approx([held[1].pressure] * 5, abs=1e-9)
    assert held[1].pressure == pytest.approx(5e3, abs=5.0)
    for shot in held[1:6]:
        assert shot.rise == pytest.approx(0.8, abs=0.06)
        assert shot.hold == pytest.approx(shot.time + 6.0 - 10.8, abs=0.06)
    assert (held[6].hold, held[6].rise) == pytest.approx((0.0, 4.0), abs=0.2)
    assert held[6].pressure == pytest.approx(np.interp(34.0, at, pressures), abs=20.0)


def test_a_rise_begins_where_the_pressure_does(tmp_path):
    """Frames 2 s apart, and steps of 0.4 s that begin 1.2 s after one: the time before belongs to the hold before."""
    steps = films.Program((0.0, 2e3, 3e3), (0.0, 3.2, 9.2), 0.4, 14.0)
    films.log(tmp_path / "log.csv", steps, 0.0, noise=3.0)
    motion = film.Motion(np.arange(0.0, 14.0, 0.25), np.zeros(56), 0.1, 1.0)
    shots = film.history_of(motion, film.read_log(tmp_path / "log.csv"), 0.0, 2.0, None)
    assert [shot.rise for shot in shots[2:]] == pytest.approx([0.4] * 5, abs=0.05)
    rows = [f"{shot.name},{shot.pressure} Pa,20 Pa,{shot.time} s,{shot.hold} s,{shot.rise} s" for shot in shots]
    (tmp_path / "photos.csv").write_text("\n".join(["file,pressure,error,time,hold,rise", *rows]) + "\n")
    for shot in shots:
        (tmp_path / shot.name).touch()
    *_, last = photo_list.read_photos(tmp_path / "photos.csv")
    wanted = [0.0, 0.4, 0.8, 2.8, 4.8, 6.0, 6.4, 6.8, 8.8]
    assert [time for time, _ in last.history] == pytest.approx(wanted, abs=0.06)


@pytest.mark.parametrize("seed", range(4))
def test_noise_of_a_log_parts_no_hold(seed):
    """Noise of 0.8 % of the range, by which single readings leave 1 % of it; a step of 10 % is another hold."""
    at = np.arange(0.0, 40.0, 0.1)
    pressures = np.interp(at, [10.0, 10.5, 20.0, 20.5], [0.0, 4.5e3, 4.5e3, 5e3])
    log = film.Log(at, pressures + np.random.default_rng(seed).normal(0.0, 40.0, len(at)))
    motion = film.Motion(np.arange(0.0, 40.0, 0.1), np.zeros(400), 0.1, 1.0)
    held = [shot.pressure for shot in film.history_of(motion, log, 0.0, 2.0, None)]
    assert len(set(held)) == 3
    assert held == pytest.approx([0.0] * 6 + [4.5e3] * 5 + [5e3] * 9, abs=25.0)


def test_log_of_another_film_is_rejected(taken, tmp_path):
    other = films.Program((0.0, 9e3, 3e3, 20e3, 1e3, 15e3), (0.0, 1.0, 1.9, 5.5, 7.6, 8.3), 0.25)
    with pytest.raises(film.FilmError, match="does not fit the motion"):
        film.check_clocks(film.align(taken[1], logged(tmp_path, program=other)), given=False)
    with pytest.raises(film.FilmError, match="given --clock-offset"):
        film.check_clocks(film.align(taken[1], logged(tmp_path), (OFFSET + 1.0, 0.0)), given=True)


@pytest.mark.campaign
def test_regular_steps_ask_for_the_offset(tmp_path):
    count = 14
    steps = films.Program(tuple(1e3 * k for k in range(count)), tuple(1.0 * k for k in range(count)), 0.3, 14.0)
    films.film(tmp_path / "steps.mp4", steps, fps=12.5)
    motion, log = film.motion_of(tmp_path / "steps.mp4"), logged(tmp_path, program=steps, end=17.0)
    with pytest.raises(film.FilmError, match=r"two offsets .* --clock-offset"):
        film.check_clocks(film.align(motion, log), given=False)
    clocks = film.align(motion, log, (OFFSET + 0.1, 0.1))
    film.check_clocks(clocks, given=False)
    assert abs(clocks.offset - OFFSET) < motion.step


@pytest.mark.campaign
def test_blurred_frame_and_moved_camera_are_doubted(tmp_path):
    short = films.Program((0.0, 16e3, 16e3), (0.0, 2.0, 3.0), 0.6, 4.0)

    def said(**how):
        films.film(tmp_path / "odd.avi", short, fps=10.0, code="MJPG", **how)
        shots = [film.Shot((n,), n / 10.0, p, 50.0) for n, p in ((5, 0.0), (23, 9e3), (35, 16e3))]
        film.write_shots(tmp_path / "odd.avi", shots, tmp_path)
        made = views.views(photo_list.read_photos(tmp_path / film.LIST), scene())
        return [" ".join(getattr(outcome, "reasons", ["refused"])) for outcome in made.outcomes]

    first, blurred, last = said(exposure=0.1)
    assert (first, last) == ("", "")
    assert "blurred by motion" in blurred
    assert "moved by 6." in said(shift=lambda time: (0.0, 0.0 if time < 3.0 else 6.0))[2]


def test_unusable_films_and_logs_are_rejected(taken, tmp_path):
    (tmp_path / "text.mp4").write_text("no film")
    for file, why in ((tmp_path / "text.mp4", "no frames"), (tmp_path / "none.mp4", "there is no film")):
        with pytest.raises(film.FilmError, match=why):
            film.motion_of(file)
    films.film(tmp_path / "still.mp4", films.Program((0.0,), (0.0,), until=3.0))
    with pytest.raises(film.FilmError, match="nothing moves"):
        film.motion_of(tmp_path / "still.mp4")
    films.film(tmp_path / "rising.mp4", films.Program((0.0, 24e3), (0.0, 0.0), takes=3.0, until=3.0))
    with pytest.raises(film.FilmError, match="never comes to rest"):
        film.motion_of(tmp_path / "rising.mp4")
    (tmp_path / "log.csv").write_text("time (s),pressure\n0,1\n1,2\n2,3\n3,4\n")
    with pytest.raises(film.FilmError, match="has no unit"):
        film.read_log(tmp_path / "log.csv")
    (tmp_path / "log.csv").write_text("time (s),pressure (kPa)\n0,1\n1,2\n0.5,3\n3,4\n")
    with pytest.raises(film.FilmError, match="line 4: its time is before"):
        film.read_log(tmp_path / "log.csv")
    result = CliRunner().invoke(view_command, ["photos.csv", *arguments(tmp_path, "--every", "1s")])
    assert (result.exit_code, "--every is for a film" in result.output) == (2, True)


def test_log_of_clock_times_is_read(tmp_path):
    (tmp_path / "log.csv").write_text("Time;Pressure [bar]\n10:00:00,5;0\n10:00:01,5;0,1\n10:00:02,5;0,2\n10:01:00,0;0,1\n")
    log = film.read_log(tmp_path / "log.csv")
    assert log.times - log.times[0] == pytest.approx([0.0, 1.0, 2.0, 59.5])
    assert log.pressures == pytest.approx([0.0, 1e4, 2e4, 1e4])


def test_setup_takes_the_first_frame_of_a_film(taken, tmp_path):
    words = [str(taken[0] / "finger.mp4"), "--scale", "4px/mm+-0.02px/mm", "--lens", "none", "-o", str(tmp_path / "setup.toml")]
    result = CliRunner().invoke(setup_command, words)
    assert (result.exit_code, "nan" in result.output) == (0, False), result.output
    assert Setup.from_file(tmp_path / "setup.toml").camera.size == films.SIZE
