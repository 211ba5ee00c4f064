"""The states of a Micromodem's driver, the causes of transitions, and the table of all transitions.

Theory of operation
-------------------
A fresh connection, or a modem that reports a reboot (or suddenly has another address), is configured setting by
setting: each is sent once the previous one is confirmed (`configuration.py`). Then its clock is checked, set if it is
off, and checked again (`clock.py`). Only then are packets sent (`sending.py`). One transmission is one cycle of
sentences:

    host                              modem
    $CCCYC,0,src,dest,rate,0,frames   $CACYC (echo)
                                      $CADRQ (requests a frame)       once per frame
    $CCTXD (frame)                    $CATXD (accepted)
                                      $CATXP (transducer on) ... $CATXF (off), $CAXST (statistics)

Receptions run independently of these states (`receiving.py`), and so do later clock checks.

Any transition that `TRANSITIONS` lacks raises RuntimeError: it is a bug here and not in the modem.
"""

import enum


class State(enum.Enum):
    """State of the driver."""

    CLOSED = "closed"
    CONFIGURING = "configuring"
    CLOCK = "clock"
    IDLE = "idle"
    CYCLING = "cycling"
    REQUESTING = "requesting"
    GIVING = "giving"
    SENDING = "sending"
    PINGING = "pinging"


class Cause(enum.Enum):
    """Cause of a transition."""

    OPENED = "opened"
    CLOSED = "closed"
    CONFIGURED = "configured"
    CLOCKED = "clocked"
    SEND = "send"
    ECHO = "echo"
    REQUEST = "request"
    STARTED = "started"
    FINISHED = "finished"
    PING = "ping"
    FAILED = "failed"
    REBOOTED = "rebooted"


TRANSITIONS: dict[tuple[State, Cause], State] = {
    (State.CLOSED, Cause.OPENED): State.CONFIGURING,
    (State.CONFIGURING, Cause.CONFIGURED): State.CLOCK,  # every setting is confirmed, or refused and not required
    (State.CLOCK, Cause.CLOCKED): State.IDLE,  # the clock is right, or set, or cannot be set (reported)
    (State.IDLE, Cause.SEND): State.CYCLING,  # $CCCYC written
    (State.CYCLING, Cause.ECHO): State.REQUESTING,  # $CACYC with our address
    (State.CYCLING, Cause.REQUEST): State.GIVING,  # the echo's line was lost; $CCTXD written
    (State.REQUESTING, Cause.REQUEST): State.GIVING,  # $CADRQ; $CCTXD written
    (State.GIVING, Cause.REQUEST): State.GIVING,  # $CADRQ for the next frame; $CCTXD written
    (State.GIVING, Cause.STARTED): State.SENDING,  # $CATXP
    (State.GIVING, Cause.FINISHED): State.IDLE,  # $CATXF: the line of $CATXP was lost
    (State.SENDING, Cause.FINISHED): State.IDLE,  # $CATXF
    (State.IDLE, Cause.PING): State.PINGING,  # $CCMPC written
    (State.PINGING, Cause.FINISHED): State.IDLE,  # $CAMPR
    # refused, data timeout, too late, or no answer
    **{
        (state, Cause.FAILED): State.IDLE
        for state in (State.CYCLING, State.REQUESTING, State.GIVING, State.SENDING, State.PINGING)
    },
    # $CAREV,..,INIT, or the modem's address is not ours
    **{(state, Cause.REBOOTED): State.CONFIGURING for state in State if state is not State.CLOSED},
    **{(state, Cause.CLOSED): State.CLOSED for state in State},
}

#: States in which a cycle has begun and the transducer is not on yet.
STARTING = (State.CYCLING, State.REQUESTING, State.GIVING)
#: States from the beginning of a cycle to the end of its transmission.
TRANSMITTING = (*STARTING, State.SENDING)
