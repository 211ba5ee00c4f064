"""The dialogue of auv_lse modem-check: queries only, and findings with what to type."""

from __future__ import annotations

import pytest

from auv_lse_common.mission_file.sections.modem import ModemConfig
from auv_lse_comms import modem_check_command
from auv_lse_comms.micromodem.configuration import settings_of
from auv_lse_comms.micromodem.modem_check import BAND, ModemCheck
from auv_lse_comms.micromodem.sentences.fields import iso_time
from auv_lse_comms.micromodem.sentences.wire import Sentence, SentenceReader
from auv_lse_comms.transport import AddressError

NOW_S = 1_777_802_400.0


class Modem:
    """A modem that answers queries from a dictionary, and refuses other settings."""

    def __init__(self, values, offset_s=0.0, source="USER_CMD", pps="RTC"):
        self.values, self.clock = values, (offset_s, source, pps)
        self.asked = []
        self._reader = SentenceReader()

    def answer(self, now_s, data):
        out = b""
        for sentence in self._reader.feed(data):
            self.asked.append(sentence)
            name = sentence.fields[0]
            if sentence.type == "CCTMQ":
                out += Sentence("CATMQ", (iso_time(now_s + self.clock[0]), *self.clock[1:])).encode()
            elif name in self.values:
                out += Sentence("CACFG", (name, self.values[name])).encode()
            else:
                out += Sentence("CAERR", ("120000", "NMEA", "4", f"{name}: unknown")).encode()
        return out


def right(config, address=2):
    return {setting.name: setting.value for setting, _ in settings_of(config, address)}


def config(**values):
    return ModemConfig(kind="micromodem", port="/dev/null", **values)


def checked(modem, settings, address=2, noise=b""):
    check, now_s, data = ModemCheck(settings, address), NOW_S, noise
    for _ in range(2000):
        check.receive(now_s, data)
        data = modem.answer(now_s, check.outgoing()) if modem else b""
        now_s += 0.05
        if check.over:
            return check
    raise AssertionError("it does not end")


def texts(check, ok):
    return [finding.text for finding in check.findings() if finding.ok is ok]


def test_a_modem_that_is_set_up_lacks_nothing_and_is_only_asked():
    settings = config()
    modem = Modem(right(settings) | {"BND": "1", "FC0": "25120", "BW0": "5000"})
    check = checked(modem, settings)
    assert texts(check, False) == []
    assert "SRC = 2" in texts(check, True)
    assert "BND = 1, FC0 = 25120, BW0 = 5000: must be equal on all modems" in " ".join(texts(check, None))
    assert "a 252-byte packet takes 2.0 s" in " ".join(texts(check, None))
    assert {sentence.type for sentence in modem.asked} == {"CCCFQ", "CCTMQ"}
    assert len(modem.asked) == len(settings_of(settings, 2)) + len(BAND) + 1


def test_a_setting_that_differs_is_named_with_what_to_type():
    settings = config(settings={"BND": 0})
    check = checked(Modem(right(settings) | {"SRC": "3", "BND": "1"}), settings)
    notes = texts(check, None)
    hand = Sentence("CCCFG", ("SRC", "2")).encode().decode().strip()
    assert f"SRC = 3, but must be 2 (is it the modem of vehicle 3?): the driver sets it; by hand: {hand}" in notes
    assert any(note.startswith("BND = 1, but must be 0: the driver sets it; by hand: $CCCFG,BND,0*") for note in notes)
    assert not any("must be equal" in note for note in notes)


def test_settings_that_it_does_not_know_are_missing_if_the_driver_needs_them():
    settings = config()
    values = right(settings)
    del values["CST"], values["MFD"]
    check = checked(Modem(values), settings)
    (missing,) = texts(check, False)
    assert missing.startswith("CST: CST: unknown; it must be 1")
    assert any(note.startswith("MFD: ") for note in texts(check, None))


def test_its_clock_is_compared_with_the_hosts():
    def clock(offset_s, **values):
        settings = config(**values)
        check = checked(Modem(right(settings), offset_s), settings)
        return next(finding for finding in check.findings() if finding.text.startswith("clock: "))

    assert clock(0.0).ok is True
    assert "clock: +6." in clock(7.0).text  # whole seconds
    assert clock(7.0).ok is None
    assert "the driver sets it" in clock(7.0).text
    late = clock(-9.0, set_clock=False)
    assert late.ok is False
    assert "clock: -8." in late.text
    assert "Set it, or modem.set_clock: true" in late.text


def test_a_clock_that_is_a_little_late_is_not_said_to_be_off_by_minus_zero():
    check = ModemCheck(config(), 2)
    check.receive(NOW_S, Sentence("CATMQ", (iso_time(NOW_S - 1.0), "RTC", "RTC")).encode())
    check.receive(NOW_S + 0.03, Sentence("CATMQ", (iso_time(NOW_S - 1.0), "RTC", "RTC")).encode())
    assert "clock: +0.0 s from this computer's" in " ".join(finding.text for finding in check.findings())


def test_synchronous_transmissions_need_a_pulse_per_second():
    settings = config(synchronous=True)
    for pps, ok in (("EXT", True), ("EXT_SYNC", True), ("RTC", False)):
        check = checked(Modem(right(settings), pps=pps), settings)
        (finding,) = [finding for finding in check.findings() if finding.text.startswith("PPS: ")]
        assert finding.ok is ok
    # before the driver has set SNV, the modem may not report its PPS
    check = checked(Modem(right(settings) | {"SNV": "0"}), settings)
    assert not texts(check, False)


def test_silence_and_garbled_lines_are_told_apart():
    assert "Check power, cable" in texts(checked(None, config()), False)[0]
    check = checked(None, config(), noise=b"\xfe\x80\r\n$CA\x81\xff\r\n")
    assert "2 garbled lines and no answer" in texts(check, False)[0]
    assert "--baud" in texts(check, False)[0]


def test_a_lost_answer_is_asked_for_again():
    settings = config()
    modem, lost = Modem(right(settings)), []
    real = modem.answer

    def answer(now_s, data):
        if b"CST" in data and not lost:
            return lost.append(data) or b""
        return real(now_s, data)

    modem.answer = answer
    check = checked(modem, settings)
    assert lost
    assert "CST = 1" in texts(check, True)
    assert texts(check, False) == []


def test_the_firmware_is_shown_when_it_is_reported():
    settings = config()
    revision = Sentence("CAREV", ("120000", "AUV", "2.0.27087")).encode()
    assert "firmware: 2.0.27087" in texts(checked(Modem(right(settings)), settings, noise=revision), True)


def test_a_port_that_is_no_address_is_named_as_it_was_typed():
    with pytest.raises(AddressError, match=r"^'ttyUSB0' is not an address"):
        modem_check_command.run(modem_check_command.parser().parse_args(["ttyUSB0"]))
