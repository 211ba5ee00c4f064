"""NMEA 0183 as plotters, multiplexers and loggers write it."""

from __future__ import annotations

import numpy as np
import pytest
from adjust.survey_logs import ORIGIN, START_S, depth_m, nmea, sentence, survey

from auv_lse_common.vocabulary.frames import geodetic_from_local, local_from_geodetic
from auv_lse_shore.survey_import.command import parser, user_facts
from auv_lse_shore.survey_import.gather import gather
from auv_lse_shore.survey_import.log_content import NO_FIX, Clock, LogContent, Reference
from auv_lse_shore.survey_import.log_file import ReadOptions
from auv_lse_shore.survey_import.reading import read_logs
from auv_lse_shore.survey_import.survey_log import LogError

DAY_S = 86_400.0


def content_of(tmp_path, data, **options) -> LogContent:
    path = tmp_path / "log.txt"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    (content,) = read_logs(path, ReadOptions(**options), lambda share: None)
    return content


def gathered(tmp_path, data, *arguments):
    """What is found in a log: its soundings' rows, and the lines for the user."""
    path = tmp_path / "a.log"
    if data is not None:
        path.write_bytes(data if isinstance(data, bytes) else data.encode())
    options = parser().parse_args([str(path if data is not None else tmp_path), *arguments])
    return gather(options.logs, user_facts(options))


def soundings_of(tmp_path, data, *arguments):
    """The soundings (n, 4) of a log, and how far they are from the known bottom (m)."""
    found = gathered(tmp_path, data, "--origin", "46.5", "6.6", "--draught", "0.3", *arguments)
    rows = found.placed[0].soundings
    return rows, rows[:, 3] - depth_m(rows[:, 1], rows[:, 2])


def gga(stamp_s, lat, lon):
    rows = nmea([(stamp_s, lat, lon, 1.0)]).splitlines(keepends=True)
    return rows[1]


def test_hemispheres_midnight_units_and_offsets(tmp_path):
    lat, lon = geodetic_from_local(np.arange(60.0), np.zeros(60), -33.5, -70.25)
    rows = np.column_stack([START_S - START_S % DAY_S + DAY_S - 30 + np.arange(60), lat, lon, np.full(60, 5.0)])
    text = "".join(line for line in nmea(rows).splitlines(keepends=True) if "RMC" not in line)  # no date
    content = content_of(tmp_path, "23:59:59 " + text.replace("\r\n", "\r\n2026 "))
    positions = content.positions["GPGGA"]
    assert content.clock is Clock.DAY
    assert np.diff(positions[:, 0]) == pytest.approx(1.0)
    assert positions[0, 1:] == pytest.approx([-33.5, -70.25], abs=1e-6)
    assert content.sounders["SDDBT"].rows[:, 1] == pytest.approx(5.0)
    at = "$GPGGA,120000,3330.0,S,07015.0,W,1,9,1,0,M,0,M,,\n"
    dpt = content_of(tmp_path, at + "$SDDPT,4.0,0.5\n$SDDPT,4.1,0.5\n$SDDPT,,\n").sounders["SDDPT"]
    assert dpt.reference is Reference.SURFACE
    assert dpt.rows[:, 1] == pytest.approx([4.5, 4.6])
    keel = content_of(tmp_path, at + "$SDDPT,4.0,-0.5\n").sounders["SDDPT"]
    assert keel.reference is Reference.TRANSDUCER
    assert keel.rows[:, 1] == pytest.approx([4.0])
    feet = content_of(tmp_path, at + "$SDDBT,10.0,f,,M,,F\n$SDDBT,,f,,M,2.0,F\n").sounders["SDDBT"]
    assert feet.rows[:, 1] == pytest.approx([3.048, 3.6576])
    damaged = content_of(tmp_path, at + "$SDDBT,abc,f,,M,,F\n")
    assert "SDDBT" not in damaged.sounders
    assert damaged.left_out["DBT sentences that are incomplete"] == 1


def test_odd_offsets_of_plotters_do_not_cost_the_depth(tmp_path):
    rows = survey()[:60]
    text = "".join(gga(*row[:3]) + sentence(f"SDDPT,{row[3]:.1f},-1.-1,") for row in rows)
    soundings, error = soundings_of(tmp_path, text)
    assert len(soundings) == 60
    assert np.abs(error).max() < 0.06  # the sentences' decimals


def test_two_days_in_one_file_keep_their_dates(tmp_path):
    rows = survey()[:100]
    cold = sentence("GPRMC,095959.00,V,,,,,,,060180,,,N")  # a receiver without a fix has a date of its own
    second = nmea(np.add(rows, [DAY_S, 0.0, 0.0, 0.0])).replace("030526", "040526")
    second = "".join(sentence(line[1:].split("*")[0]) for line in second.splitlines())
    soundings, error = soundings_of(tmp_path, cold + nmea(rows) + cold + second)
    assert len(soundings) == 200
    assert soundings[[0, 100], 0] == pytest.approx([START_S, START_S + DAY_S])
    assert np.abs(error).max() < 0.02


def test_depths_between_slow_positions_are_where_the_boat_was(tmp_path):
    rows = survey()[:300]
    lines = [
        (gga(*row[:3]) if i % 10 == 0 else "") + sentence(f"SDDBT,,f,{row[3]:.2f},M,,F") for i, row in enumerate(rows)
    ]
    placed = gathered(tmp_path, "".join(lines), "--origin", "46.5", "6.6").placed[0]
    assert len(placed.soundings) == 291  # after the last position, nobody knows
    north, east = local_from_geodetic(rows[:291, 1], rows[:291, 2], *ORIGIN)
    off_m = np.hypot(placed.soundings[:, 1] - north, placed.soundings[:, 2] - east)
    assert np.median(off_m) < 0.1
    stds = [np.interp(placed.soundings[:, 0], placed.track[:, 0], placed.track_std_m[:, c]) for c in (0, 1)]
    stated = np.hypot(*stds)
    # where lanes turn, a straight line misses up to 10 m of the way, and that is stated
    assert off_m.max() < 4.0 * stated.max()
    assert (off_m < 2.0 * stated).mean() > 0.9


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[:40] + b"\0" + text[40:],
        lambda text: text.decode().encode("utf-16"),
        lambda text: text.decode().encode("utf-16-le"),
        lambda text: (
            b"\x81\xfe\x01 boot\r\n" * 3
            + text.replace(b"\r\n", b"\r\n!AIVDM,1,1,,A,13aEOK?P00PD2wVMdLDRhgvL289?,0*26\r\n")
        ),
        lambda text: text.replace(b"\r\n", b"\r"),
    ],
    ids=["zero", "UTF-16", "UTF-16 without mark", "AIS and garbage", "old line ends"],
)
def test_captures_with_other_bytes_are_read(tmp_path, damage):
    soundings, error = soundings_of(tmp_path, damage(nmea(survey()[:100]).encode()))
    assert len(soundings) >= 99
    assert np.abs(error).max() < 0.02


@pytest.mark.parametrize("kind", ["GLL", "GNS"])
def test_positions_of_other_sentences_are_read(tmp_path, kind):
    lines = []
    for line in nmea(survey()[:100]).splitlines():
        f = line[1:].split("*")[0].split(",")
        if f[0] == "GPGGA":
            rest = (
                f"{','.join(f[2:6])},{f[1]},A,D" if kind == "GLL" else f"{f[1]},{','.join(f[2:6])},AAN,12,0.7,1.0,2.0,,"
            )
            clock = f"GPZDA,{f[1]},03,05,2026,00,00"
            lines.append(sentence(clock) + sentence(f"GN{kind},{rest}"))
        elif f[0] == "SDDBT":
            lines.append(sentence(",".join(f)))
    soundings, error = soundings_of(tmp_path, "".join(lines))
    assert len(soundings) == 100
    assert soundings[0, 0] == START_S
    assert np.abs(error).max() < 0.02


def test_two_talkers_are_two_sounders(tmp_path):
    rows = survey()[:100]
    other = "".join(sentence(f"YDDBT,,f,{1.0 + 0.01 * i:.2f},M,,F") for i in range(2))
    text = nmea(rows).replace("$GPRMC", other + "$GPRMC")
    soundings, error = soundings_of(tmp_path, text, "--sounder", "sddbt")
    assert len(soundings) == 100
    assert np.abs(error).max() < 0.02
    (line, *_) = gathered(tmp_path, text, "--sounder", "SDDBT").lines
    assert 'of YDDBT, 1.0 to 1.0 m (--sounder "YDDBT" takes them instead)' in line
    with pytest.raises(LogError, match="no log has it; it can be SDDBT, YDDBT"):
        gathered(tmp_path, text, "--sounder", "XXDBT")


def test_wrong_checksums_are_refused_with_their_count_and_can_be_accepted(tmp_path):
    text = "\r\n".join(line.split("*")[0] + "*00" for line in nmea(survey()[:100]).splitlines())
    with pytest.raises(LogError, match=r"9\d DBT sentences with a wrong checksum \(--accept-checksums uses them\)"):
        gathered(tmp_path, text)
    soundings, error = soundings_of(tmp_path, text, "--accept-checksums")
    assert len(soundings) == 100
    assert np.abs(error).max() < 0.02


def test_all_depths_end_at_the_surface_and_an_unknown_draught_is_asked_for(tmp_path):
    rows = survey()[:60]
    found = {}
    for name, body, draught in (
        ("DPT", "SDDPT,{0:.2f},0.3", ()),
        ("DBS", "SDDBS,,f,{1:.2f},M,,F", ()),
        ("DBT", "SDDBT,,f,{0:.2f},M,,F", ("--draught", "0.3")),
        ("DBK", "SDDBK,,f,{2:.2f},M,,F", ("--draught", "0.8")),
    ):
        text = "".join(gga(*r[:3]) + sentence(body.format(r[3], r[3] + 0.3, r[3] - 0.5)) for r in rows)
        logs = gathered(tmp_path, text, *draught)
        found[name] = logs.placed[0].soundings[:, 3]
        assert not any("below the" in line and "unknown" in line for line in logs.lines)
    for name, depths in found.items():
        assert depths == pytest.approx(found["DBT"], abs=0.011), name
    assert any("depths are below the keel, whose depth is unknown" in line for line in gathered(tmp_path, text).lines)


def test_a_given_draught_replaces_the_one_that_the_log_states(tmp_path):
    rows = survey()[:60]
    text = "".join(gga(*r[:3]) + sentence(f"SDDPT,{r[3]:.2f},0.3") for r in rows)
    found = gathered(tmp_path, text, "--draught", "0.5")
    assert found.placed[0].soundings[:, 3] == pytest.approx(rows[:, 3] + 0.5, abs=0.011)
    assert "0.5 m added instead of the 0.3 m that the log states (--draught)" in found.lines[0]


def test_a_log_without_dates_asks_for_them(tmp_path):
    text = "".join(line for line in nmea(survey()[:60]).splitlines(keepends=True) if "RMC" not in line)
    assert "times of day and no date: --date 2026-06-14 gives it" in gathered(tmp_path, text).lines[-1]
    soundings, _ = soundings_of(tmp_path, text, "--date", "2026-05-03")
    assert soundings[0, 0] == START_S


def stamped(text, form, ahead_s=0.0):
    """Sentences without RMC, each behind the time of a logger."""
    found = []
    for k, line in enumerate(line for line in text.splitlines(keepends=True) if "RMC" not in line):
        moment = np.datetime64(round(1e3 * (START_S + ahead_s + k // 2)) + 123, "ms").astype("O")
        found.append(f"{moment:{form}}{line}")
    return "".join(found)


@pytest.mark.parametrize(
    ("form", "ahead_s"),
    [
        ("%Y-%m-%dT%H:%M:%S.%fZ ", 0.0),
        ("%Y-%m-%dT%H:%M:%S.%fZ,", 0.0),
        ("%Y-%m-%d %H:%M:%S;", 0.0),
        ("%Y-%m-%dT%H:%M:%S\t", 39_600.0),  # a local clock
        ("%Y-%m-%dT%H:%M:%S+11:00 ", 39_600.0),
        ("%Y/%m/%d %H:%M:%S,%f ", -36_000.0),
        ("[%Y-%m-%d %H:%M:%S.%f] ", 3_600.0),
    ],
)
def test_the_time_of_a_logger_before_each_sentence_gives_the_date(tmp_path, form, ahead_s):
    rows = survey()[:60]
    soundings, error = soundings_of(tmp_path, stamped(nmea(rows), form, ahead_s))
    assert soundings[0, 0] == START_S
    assert len(soundings) == 60
    assert np.abs(error).max() < 0.02
    found = gathered(tmp_path, stamped(nmea(rows), form, ahead_s))
    assert "the date is that of the times before the sentences" in found.lines[0]
    assert not any("--date" in line for line in found.lines)


def test_dates_of_the_receiver_count_more_than_those_of_a_logger(tmp_path):
    """Before midnight, at midnight, and with RMC or ZDA a day apart from the logger's clock."""
    night = nmea([(t + 50_385.0, *rest) for t, *rest in survey()[:60]])
    soundings, _ = soundings_of(tmp_path, stamped(night, "%Y-%m-%dT%H:%M:%SZ ", 50_385.0))
    assert soundings[[0, -1], 0] == pytest.approx([START_S + 50_385.0, START_S + 50_444.0], abs=0.1)
    plain = nmea(survey()[:60])
    late = stamped(plain, "%Y-%m-%dT%H:%M:%SZ ", 86_400.0)
    for dated in (plain.splitlines(keepends=True)[0], sentence("GPZDA,100000.00,03,05,2026,00,00")):
        found = gathered(tmp_path, late.replace("\n", f"\n{dated}", 1))
        assert found.placed[0].soundings[0, 0] == START_S
        assert "times before" not in found.lines[0]


def test_a_lost_count_of_weeks_is_found_and_corrected(tmp_path):
    text = nmea(survey()[:60]).replace("030526", "170906")  # 1,024 weeks earlier
    text = "".join(sentence(line[1:].split("*")[0]) for line in text.splitlines())
    said = gathered(tmp_path, text).lines[-1]
    assert "If it is really from 2026-05-03, its GPS receiver lost 1,024 weeks: --date 2026-05-03" in said
    corrected = gathered(tmp_path, text, "--date", "2026-05-03")
    assert corrected.placed[0].soundings[0, 0] == START_S
    assert not any("1,024 weeks" in line for line in corrected.lines)


def test_the_same_sounding_in_two_files_counts_once(tmp_path):
    rows = survey()
    (tmp_path / "day.log").write_text(nmea(rows))
    (tmp_path / "noon.log").write_text(nmea(rows[200:400]))
    found = gathered(tmp_path, None)
    assert "- left out: 200 soundings that another file has, too" in found.lines
    assert sum(len(log.soundings) for log in found.placed) == len(rows)


@pytest.mark.parametrize("after", ["", "\0\0\0", "$GPGGA,120001,3330.0,S,07015.0,W,1,9,1,0,M,0,M,,\n"])
@pytest.mark.parametrize("has_checksums", [True, False])
def test_a_depth_that_is_cut_off_is_left_out(tmp_path, after, has_checksums):
    lines = [sentence(f"SDDBT,,f,{18.5 + k / 100:.2f},M,,F") for k in range(4)]
    lines = lines if has_checksums else [line.partition("*")[0] + "\r\n" for line in lines]
    lines[3] = "$SDDBT,,f,1"
    start = "$GPGGA,120000,3330.0,S,07015.0,W,1,9,1,0,M,0,M,,\n"
    content = content_of(tmp_path, start + "".join(lines) + after)
    assert content.sounders["SDDBT"].rows[:, 1] == pytest.approx([18.5, 18.51, 18.52])
    assert content.left_out["DBT sentences that are incomplete"] == 1


def test_positions_by_dead_reckoning_are_no_fixes(tmp_path):
    lines = [line.split("*")[0] for line in nmea(survey()[:60]).splitlines() if "GGA" not in line]
    lines[::4] = [line.removesuffix("A") + "E" for line in lines[::4]]  # every other RMC
    content = content_of(tmp_path, "\r\n".join(lines))
    assert len(content.positions["GPRMC"]) == 30
    assert content.left_out[NO_FIX] == 30


def test_a_transducers_depth_that_changes_is_reported(tmp_path):
    lines = [line for line in nmea(survey()[:60]).splitlines() if "RMC" in line or "GGA" in line]
    rmc = [line for line in lines if "RMC" in line]
    text = "".join(f"{line}\r\n$SDDPT,10.0,{0.5 if i > 30 else 0.0}\r\n" for i, line in enumerate(rmc))
    said = " ".join(content_of(tmp_path, text).notes)
    assert "SDDPT states a transducer's depth that changes from 0 to 0.5 m" in said
    assert "changes" not in " ".join(content_of(tmp_path, text.replace(",0.0", ",0.5")).notes)


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ("10.0,f,,M,,F", 3.048),
        ("10.0,f", 3.048),
        (",f,,M,2.0,F", 3.6576),
        ("32.8,f,10.0,M,5.5,F", 10.0),
        ("10.0,M,,,,", 10.0),
        ("10.0,m,32.8,f,5.5,F", 10.0),
        (",,10.0,f,,", 3.048),
        (",,10.0,F,,", 18.288),
        (",,,,10.0,M", 10.0),
        ("10.0,,,,,", 3.048),
        ("10.0,F,,M,,F", None),  # a fathom, or a foot in capitals
        (",f,,M,2.0,f", None),
        ("10.0,x,,M,,F", None),
    ],
)
def test_the_letter_of_a_depth_states_its_unit(tmp_path, fields, expected):
    at = "$GPGGA,120000,3330.0,S,07015.0,W,1,9,1,0,M,0,M,,\n"
    content = content_of(tmp_path, at + f"$SDDBT,{fields}\n")
    if expected is None:
        assert "SDDBT" not in content.sounders
        assert content.left_out["DBT sentences whose letters are not a unit, or may be two (f: feet, F: fathoms)"] == 1
    else:
        assert content.sounders["SDDBT"].rows[:, 1] == pytest.approx([expected], abs=0.01)


def dated(rows, date=""):
    """A log whose dates are those of its times, or another one (ddmmyy)."""
    text = ""
    for row in rows:
        day = date or str(np.datetime64(int(row[0]), "s").astype("O").strftime("%d%m%y"))
        for line in nmea([row]).splitlines():
            text += sentence(line[1:].split("*")[0].replace("030526", day))
    return text


@pytest.mark.parametrize("first", ["060180", "050180", "220899", "010100"])
def test_what_a_receiver_reports_before_it_has_the_date_is_left_out(tmp_path, first):
    rows = survey()[:120]
    found = gathered(tmp_path, dated(rows[:20], first) + dated(rows[20:]), "--draught", "0.3")
    soundings = found.placed[0].soundings
    assert soundings[0, 0] == pytest.approx(rows[20, 0], abs=2.0)
    assert 95 <= len(soundings) <= 100
    assert "before the clock was set" in " ".join(found.lines)


@pytest.mark.parametrize("middle_s", [946_684_800.0, 788_918_400.0])  # the begin of 2000, and of 1995
def test_a_survey_over_the_turn_of_a_year_and_an_old_one_are_whole(tmp_path, middle_s):
    rows = survey()[:120]
    rows[:, 0] += middle_s - rows[60, 0]
    found = gathered(tmp_path, dated(rows), "--draught", "0.3")
    assert len(found.placed[0].soundings) >= 119
    assert "before the clock was set" not in " ".join(found.lines)


@pytest.mark.parametrize("first", ["140698", "060196", "080180", "200899", "150700"])
def test_a_log_that_joins_an_old_survey_to_a_new_one_keeps_both(tmp_path, first):
    rows = survey()[:120]
    found = gathered(tmp_path, dated(rows[:60], first) + dated(rows[60:]), "--draught", "0.3")
    assert sum(len(log.soundings) for log in found.placed) >= 118
    assert "before the clock was set" not in " ".join(found.lines)


def test_what_a_receiver_reports_before_an_old_survey_is_left_out_alone(tmp_path):
    rows = survey()[:120]
    parts = dated(rows[:20], "060180"), dated(rows[20:70], "140698"), dated(rows[70:])
    found = gathered(tmp_path, "".join(parts), "--draught", "0.3")
    assert 96 <= sum(len(log.soundings) for log in found.placed) <= 100
    assert "before the clock was set" in " ".join(found.lines)


@pytest.mark.parametrize("later_s", [0.0, 0.5])
def test_joined_logs_of_two_boats_at_the_same_time_are_refused(tmp_path, later_s):
    rows = survey()[:120]
    other = rows + np.array([later_s, 0.01, 0.0, 5.0])
    with pytest.raises(LogError, match=r"swing to and fro by 1,1\d\d m: it may hold the logs of two boats.*Split it"):
        gathered(tmp_path, nmea(rows) + nmea(other))


def test_a_log_that_is_joined_to_itself_or_to_another_place_is_read(tmp_path):
    rows = survey()[:120]
    assert len(gathered(tmp_path, nmea(rows) + nmea(rows)).placed[0].soundings) >= 118
    other = rows + np.array([3600.0, 0.01, 0.0, 0.0])
    assert len(gathered(tmp_path, nmea(rows) + nmea(other)).placed[0].soundings) >= 236
    two_antennas = rows + np.array([0.0, 20.0 / 111_200.0, 0.0, 0.0])
    assert len(gathered(tmp_path, nmea(rows) + nmea(two_antennas)).placed[0].soundings) >= 118
