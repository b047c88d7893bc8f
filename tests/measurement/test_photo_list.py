"""The list of photographs: typed units, files by number, and rows that cannot be read."""

from __future__ import annotations

import pytest
from click.testing import CliRunner

from measurement.__main__ import main
from measurement.cli import photos as photos_command
from measurement.series.photo_list import PhotoListError, read_photos
from softmodels.common.folders import OwnFolderError
from tests.benchmarks import photo_series

SERIES = vars(photo_series)


def listed(folder, text, encoding="utf-8"):
    path = folder / "photos.csv"
    path.write_text(text, encoding=encoding)
    return read_photos(path)


def test_pressures_and_errors(tmp_path):
    photos = listed(
        tmp_path, "# column of the bench\n\nfile,pressure,error\na.jpg,0 cm,\nb.jpg,1.2 kPa,5 Pa\nc.jpg,10 cm,1 mm\n"
    )
    assert [photo.file.name for photo in photos] == ["a.jpg", "b.jpg", "c.jpg"]
    assert photos[0].is_zero and not photos[1].is_zero
    assert (photos[1].pressure, photos[1].pressure_error) == (1200.0, 5.0)
    assert photos[2].pressure == pytest.approx(0.1 * 970.0 * 9.80665)
    assert all(photo.file.parent == tmp_path for photo in photos)


def test_both_tubes_semicolons_capitals_and_a_byte_order_mark(tmp_path):
    photos = listed(tmp_path, "File; Left; Right\r\na.jpg; 31.2 cm; 18.7 cm\r\n", "utf-8-sig")
    assert photos[0].pressure == pytest.approx(0.125 * 970.0 * 9.80665)


def test_files_by_number_and_in_other_letters(tmp_path):
    for name in ("IMG_5965.JPG", "IMG_5966.JPG", "notes5967.txt"):
        (tmp_path / name).touch()
    photos = listed(tmp_path, "file,pressure\n5965,0 cm\nimg_5966.jpg,1 cm\n5967,2 cm\n")
    assert [photo.file.name for photo in photos] == ["IMG_5965.JPG", "IMG_5966.JPG", "5967"]
    (tmp_path / "DSC5965.jpg").touch()
    with pytest.raises(PhotoListError, match=r"line 2: 5965 matches several files: DSC5965.jpg, IMG_5965.JPG"):
        listed(tmp_path, "file,pressure\n5965,0 cm\n")


def test_lists_as_spreadsheets_write_them(tmp_path):
    """Windows' line ends, tabs in UTF-16 (Unicode text), empty rows and empty columns at the end."""
    wanted = [("a.jpg", 0.0), ("b.jpg", 1200.0)]
    for text, encoding in (
        ("file,pressure\r\na.jpg,0 cm\r\n,\r\nb.jpg,1.2 kPa\r\n", "utf-8"),
        ("file\tpressure\r\na.jpg\t0 cm\r\nb.jpg\t1.2 kPa\r\n", "utf-16"),
        ("file;pressure;;\na.jpg;0 cm;;\nb.jpg;1.2 kPa;;\n;;;\n", "utf-8-sig"),
    ):
        photos = listed(tmp_path, text, encoding)
        assert [(photo.file.name, photo.pressure) for photo in photos] == wanted


def test_a_photograph_whose_name_begins_with_the_comments_sign(tmp_path):
    """Its row was taken for a comment and dropped without a word."""
    (tmp_path / "#4.jpg").touch()
    (tmp_path / "5.jpg").touch()
    rows = "file,pressure\na.jpg,0 cm\n#5.jpg,2 cm\n# #4.jpg is blurred\n"
    assert len(listed(tmp_path, rows)) == 1
    with pytest.raises(PhotoListError, match=r"line 5: # begins a comment, but .* #4.jpg; write ./#4.jpg"):
        listed(tmp_path, rows + "#4.jpg,3 cm\n")
    assert [photo.file.name for photo in listed(tmp_path, rows + "./#4.jpg,3 cm\n")] == ["a.jpg", "#4.jpg"]


def test_one_file_by_two_names_stands_in_the_list_twice(tmp_path):
    (tmp_path / "IMG_0004.JPG").touch()
    (tmp_path / "link.jpg").symlink_to(tmp_path / "IMG_0004.JPG")
    for name in ("IMG_0004.JPG", "4", "./IMG_0004.JPG", str(tmp_path / "IMG_0004.JPG"), "link.jpg"):
        with pytest.raises(PhotoListError, match=r"line 3: .* is in the list twice"):
            listed(tmp_path, f"file,pressure\nIMG_0004.JPG,0 cm\n{name},2 cm\n")


@pytest.mark.parametrize("name", ["x" * 5000 + ".jpg", "7" * 5000, "a.jpg/b.jpg", "none/b.jpg", "=1+1", "..", "/dev/zero"])
def test_names_that_are_no_files_are_left_to_the_measuring(tmp_path, name):
    for file in ("a.jpg", "7.jpg"):
        (tmp_path / file).touch()
    assert len(listed(tmp_path, f"file,pressure\n{name},1 cm\n")) == 1


@pytest.mark.parametrize("seed", range(0, 150, 10))
def test_hostile_lists_are_read_or_refused_by_a_sentence(tmp_path, seed):
    """Formulas, wrong separators and encodings, NUL, 5000 digits, Windows' and old Macs' line ends; 2000 in the benchmark."""
    for file in ("1.jpg", "IMG_0004.JPG", "#4.jpg"):
        (tmp_path / file).touch()
    for more in range(10):
        SERIES["read_broken"](tmp_path, seed + more)


BROKEN = {
    "": "is empty",
    "# nothing\n": "is empty",
    "file,pressure\n": "no rows",
    "name,pressure\na.jpg,1 cm\n": "column 'name' is unknown",
    "pressure\n1 cm\n": "no column 'file'",
    "file\na.jpg\n": "either a column 'pressure'",
    "file,pressure,left,right\na.jpg,1 cm,1 cm,1 cm\n": "either a column 'pressure'",
    "file,left\na.jpg,1 cm\n": "one tube only",
    "file,pressure,pressure\na.jpg,1 cm,1 cm\n": "twice",
    "file,pressure\na.jpg,1\n": "line 2: '1' has no unit",
    "file,pressure\na.jpg,much\n": "line 2: 'much' is neither a column of water",
    "file,pressure\na.jpg\n": "line 2: 1 values in the row",
    "file,pressure\na.jpg,1 cm\n,2 cm\n": "line 3: the row has no file name",
    "file,pressure\na.jpg,1 cm\na.jpg,2 cm\n": "line 3: a.jpg is in the list twice",
    "file,pressure,error\na.jpg,1 cm,-1 mm\n": "line 2: the error '-1 mm' is negative",
    "file;pressure\na.jpg;0 cm\nb.jpg;2,8 cm\n": "line 3: '2,8 cm' has a decimal comma; write 2.8 cm",
    'file,pressure\na.jpg,"2,8 cm"\n': "line 2: '2,8 cm' has a decimal comma",
    "file,pressure\na.jpg,2,8 cm\n": "line 2: 3 values in the row.*decimals with a point",
    "file;left;right\na.jpg;31,2 cm;18,7 cm\n": "line 2: '31,2 cm' has a decimal comma",
    "file;pressure;error\na.jpg;3 cm;0,5 mm\n": "line 2: '0,5 mm' has a decimal comma",
    "file,pressure\na.jpg,5 647 Pa\n": "line 2: '5 647 Pa' has a space or the like between its digits",
    "file;pressure\na.jpg;35,5 mmH2O\n": "line 2: '35,5 mmH2O' has a decimal comma",
    "file,pressure\na.jpg,1 200 mmH2O\n": "line 2: '1 200 mmH2O' has a space",
    "file,left,right\na.jpg,1 kPa,1 cm\n": "line 2: '1 kPa' is not the level",
    "file,pressure\na.jpg,=1+1\n": "line 2: '=1\\+1' ",
    "file,pressure\na.jpg,1 cm,,note\n": "line 2: 4 values in the row",
    "file,pressure\na\0.jpg,1 cm\n": "NUL bytes",
    "file,pressure\n" + "x" * 200000 + ",1 cm\n": "line 2: it is not a row of a CSV file",
}


@pytest.mark.parametrize("text", BROKEN, ids=range(len(BROKEN)))
def test_broken_lists_are_bad_input_said_in_a_sentence(tmp_path, text):
    with pytest.raises(PhotoListError, match=BROKEN[text]):
        listed(tmp_path, text)
    done = CliRunner().invoke(main, ["photos", str(tmp_path / "photos.csv"), "-o", str(tmp_path / "out")])
    assert done.exit_code == 2
    assert done.stderr.startswith("softmodels: ") and "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_lists_that_cannot_be_read(tmp_path):
    (tmp_path / "photos.csv").write_bytes(b"file,pressure\nM\xfcller.jpg,1 cm\n")
    with pytest.raises(PhotoListError, match="line 2 is not UTF-8 text; save it as CSV UTF-8"):
        read_photos(tmp_path / "photos.csv")
    (tmp_path / "photos.csv").write_bytes(b"\xff\xfe\x00")
    for path in (tmp_path / "photos.csv", tmp_path / "none.csv", tmp_path):
        with pytest.raises(PhotoListError, match="cannot be read"):
            read_photos(path)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--water-density", "970"], "has no unit"),
        (["--water-density", "-1 kg/m^3"], "must be positive"),
        (["--reading-error", "-1 mm"], "must not be negative"),
        (["--setup", "none.toml"], "none.toml cannot be read"),
    ],
)
def test_bad_options_are_bad_input(tmp_path, words, reason):
    (tmp_path / "photos.csv").write_text("file,pressure\na.jpg,0 cm\n")
    done = CliRunner().invoke(main, ["photos", str(tmp_path / "photos.csv"), *words])
    assert done.exit_code == 2
    assert reason in done.stderr


TIMED = "file,pressure,hold,rise\nrest.jpg,0,,\na.jpg,1 kPa,10 s,2 s\nb.jpg,1 kPa,2 min,\nc.jpg,2 kPa,10 s,4 s\n"


def test_times_become_the_history_of_the_pressure(tmp_path):
    photos = listed(tmp_path, TIMED)
    first = ((0.0, 0.0), (2.0, 1000.0), (12.0, 1000.0))
    assert [photo.history for photo in photos[:3]] == [((0.0, 0.0),), first, (*first, (122.0, 1000.0))]
    assert photos[3].history[4:] == ((126.0, 2000.0), (136.0, 2000.0))
    assert all(photo.history == () for photo in listed(tmp_path, "file,pressure\na.jpg,1 kPa\n"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("file,pressure,hold\na.jpg,1 kPa,10 s\n", "has a column 'hold' but none 'rise'"),
        ("file,pressure,rise\na.jpg,1 kPa,10 s\n", "has a column 'rise' but none 'hold'"),
        ("file,pressure,hold,rise\na.jpg,1 kPa,10 s,2 s\nb.jpg,2 kPa,,2 s\n", "line 3: the row has no time of hold"),
        ("file,pressure,hold,rise\na.jpg,1 kPa,10 s,\n", "line 2: the row has no time of rise"),
        ("file,pressure,hold,rise\na.jpg,1 kPa,-10 s,2 s\n", "a hold of -10 s is negative"),
        ("file,pressure,hold,rise\na.jpg,1 kPa,10 s,-2 s\n", "a rise of -2 s is negative"),
        ("file,pressure,hold,rise\na.jpg,1 kPa,10,2 s\n", "hold: '10' has no unit"),
        ("file,pressure,hold,rise\na.jpg,1 kPa,10 s,2 s\nb.jpg,1 kPa,5 s,\n", "line 3: a hold of 5 s is not longer"),
    ],
)  # fmt: skip
def test_times_that_cannot_be_meant(text, said, tmp_path):
    with pytest.raises(PhotoListError, match=r"photos\.csv") as told:
        listed(tmp_path, text)
    assert said in str(told.value)


@pytest.mark.parametrize(
    ("rows", "options", "told"),
    [
        ("file,pressure\na.jpg,0 cm\nb.jpg,10 cm\n", (), True),
        ("file,left,right\na.jpg,31.2 cm,18.7 cm\n", (), True),
        ("file,pressure\na.jpg,0 cm\nb.jpg,10 cm\n", ("--water-density", "970kg/m^3"), False),
        ("file,pressure\na.jpg,0 cm\nb.jpg,1.2 kPa\n", (), False),
    ],
)
def test_heights_without_their_liquid_are_told(rows, options, told, tmp_path, monkeypatch):
    """The thesis' water is lighter than others': a list of heights says so unless its density is stated."""

    def taken(*given):
        raise OwnFolderError("enough")

    monkeypatch.setattr(photos_command.Setup, "from_file", lambda file: None)
    monkeypatch.setattr(photos_command.commands, "open_folder", taken)
    (tmp_path / "photos.csv").write_text(rows)
    done = CliRunner().invoke(main, ["photos", str(tmp_path / "photos.csv"), "--setup", str(tmp_path), *options])
    sentence = "pressures are read in cm, 0.97 g/ml, 3 % less than water at 20 degC; --water-density sets another"
    assert (sentence in done.output) == told and "enough" in done.output
