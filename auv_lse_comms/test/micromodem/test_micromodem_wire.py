"""Lines of the Micromodem: checksums, damage, and any cutting of the stream."""

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from auv_lse_comms.micromodem.sentences.messages import read_message
from auv_lse_comms.micromodem.sentences.wire import (
    MAX_COUNTED_TYPES,
    MAX_LINE,
    Sentence,
    SentenceReader,
    TypeCounts,
    checksum,
)

# Lines as real modems and WHOI's own software write them, with their checksums, typed in by hand.
REAL = [
    b"$CCCYC,0,1,0,4,0,1*5D\r\n",  # sent by acomms 3.1.1 (the facts of the project)
    b"$CACFG,SRC,1*33\r\n",
    b"$CCTMQ,0*54\r\n",
]


def one(data: bytes) -> Sentence:
    (sentence,) = SentenceReader().feed(data)
    return sentence


@pytest.mark.parametrize("line", REAL)
def test_reads_and_rewrites_real_lines(line):
    assert one(line).encode() == line


def test_checksum_by_hand():
    # 'A' ^ 'B' ^ 'C' = 0x41 ^ 0x42 ^ 0x43 = 0x40
    assert checksum("ABC") == "40"


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"$CACFG,SRC,1*34\r\n", "bad_checksum"),
        (b"$CACFG,SRC,1*3\r\n", "bad_checksum"),
        (b"$CACFG,SRC,1*333\r\n", "bad_checksum"),
        (b"$CACFG,SRC,1\r\n", "no_checksum"),
        (b"$CACFG,SR\x80,1*33\r\n", "bad_character"),
        (b"U-Boot 1.1.6 (ADI)\r\n", "not_a_sentence"),
        (b"$CACFG,SR$CACFG,SRC,1*33\r\n", "broken_off"),
        (b"junk$CACFG,SRC,1*33\r\n", "not_a_sentence"),
        (b"$" + b"A" * 5000 + b"\r\n", "overlong"),
        (b"$,1*1D\r\n", "bad_type"),
    ],
)
def test_every_kind_of_bad_line_is_counted_once_and_the_next_line_is_read(data, reason):
    reader = SentenceReader()
    found = reader.feed(data) + reader.feed(b"$CACFG,SRC,1*33\r\n")
    assert found[-1] == Sentence("CACFG", ("SRC", "1"))
    assert reader.counts[reason] == 1
    assert sum(reader.counts.values()) == reader.counts["sentences"] + 1


def test_lower_case_checksum_and_bare_line_ends_are_taken():
    reader = SentenceReader()
    assert len(reader.feed(b"$CATXF,252*51\n$CATXF,252*51\r$CAREV,1,AUV,2*0a\r\n")) == 2  # the last one is wrong
    assert reader.counts["bad_checksum"] == 1
    assert one(b"$CACYC,0,3,0,4,0,1*5d\r\n").type == "CACYC"


@given(st.lists(st.integers(1, 40), min_size=1, max_size=30), st.integers(0, 2**32))
def test_any_cutting_of_the_stream_gives_the_same_sentences(cuts, seed):
    rng = random.Random(seed)
    sentences = [Sentence("CATXF", (str(rng.randrange(10**6)),)) for _ in range(8)]
    stream = b"".join(s.encode() for s in sentences)
    reader, found, at = SentenceReader(), [], 0
    for cut in [*cuts, len(stream)]:
        found += reader.feed(stream[at : at + cut])
        at += cut
    assert found == sentences


@settings(max_examples=300)
@given(st.binary(max_size=400))
def test_garbage_never_raises_and_never_hides_a_following_sentence(junk):
    reader = SentenceReader()
    reader.feed(junk)
    assert reader.feed(b"\r\n$CATXF,252*51\r\n")[-1] == Sentence("CATXF", ("252",))


def test_a_corrupted_byte_is_caught_wherever_it_is():
    line = Sentence("CARXD", ("2", "0", "0", "1", "00FF12")).encode()
    for index in range(1, len(line) - 2):
        for flip in (0x01, 0x10, 0x80):
            bad = bytearray(line)
            bad[index] ^= flip
            good = [s for s in SentenceReader().feed(bytes(bad)) if s.type == "CARXD" and s.fields[4:] == ("00FF12",)]
            # flipping the case of a checksum letter is the only change that may pass
            assert not good or bytes(bad).upper() == line


def test_memory_is_bounded_by_the_longest_line():
    reader = SentenceReader()
    for _ in range(200):
        reader.feed(b"x" * 1000)
    assert reader.counts["overlong"] == 1
    assert len(reader._line) <= MAX_LINE


def test_unknown_types_are_no_error_and_their_count_is_bounded():
    assert read_message(Sentence("CAXXX", ())) is None
    counts = TypeCounts()
    for number in range(1000):
        counts.add(f"CA{number:03d}")
    assert len(counts.counts) == MAX_COUNTED_TYPES + 1
    assert sum(counts.counts.values()) == 1000
