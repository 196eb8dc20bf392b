"""A signal acts within seconds even if the main thread is busy, and never loses what was rendered."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

from wrt.cli.signals import SIGNALS, Interrupts

GRACE_SECONDS = 1.0
"""Grace period of the programs here, shorter than that of `wrt render`."""

# `busy` is a long call into C that releases the interpreter lock.
PROGRAM = """
import hashlib, os, sys, time
import wrt.cli.signals
from wrt.cli.signals import Interrupts

wrt.cli.signals.GRACE_SECONDS = {grace}

def give_up(status):
    print("given up", flush=True)
    os._exit(status)

def busy(rounds=1 << 30):
    hashlib.pbkdf2_hmac("sha256", b"", b"", rounds)

with Interrupts(give_up) as interrupts:
    print("ready", flush=True)
    try:
        {body}
    except KeyboardInterrupt:
        print("obeyed", flush=True)
        sys.exit(interrupts.exit_status)
print("done", flush=True)
"""


def program(body: str) -> str:
    return PROGRAM.replace("{body}", body).replace("{grace}", str(GRACE_SECONDS))


def run_and_signal(body: str, number: signal.Signals) -> tuple[int | None, str, float]:
    """Return status, output after the signal, and seconds until the program's end; None if it kept running."""
    command = [sys.executable, "-c", program(body)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    time.sleep(0.2)
    sent = time.monotonic()
    process.send_signal(number)
    try:
        out, _ = process.communicate(timeout=4.0 * GRACE_SECONDS)
    except subprocess.TimeoutExpired:
        process.kill()
        process.communicate()
        return None, "", 0.0
    return process.returncode, out, time.monotonic() - sent


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_during_python_s_own_work(number):
    status, out, seconds = run_and_signal("time.sleep(60)", number)
    assert (status, out) == (128 + number, "obeyed\n")
    assert seconds < GRACE_SECONDS


@pytest.mark.slow
@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_while_a_library_works_ends_what_has_nothing_to_save(number):
    status, out, seconds = run_and_signal("busy()", number)
    assert (status, out) == (128 + number, "given up\n")
    assert seconds > GRACE_SECONDS


def test_a_signal_never_ends_what_is_worth_saving():
    assert run_and_signal("interrupts.worth_saving = True; busy()", signal.SIGTERM)[0] is None


def test_a_signal_that_a_library_swallows_is_found_all_the_same():
    swallowing = "exec('try: time.sleep(5)\\nexcept BaseException: pass'); interrupts.check(); time.sleep(60)"
    status, out, seconds = run_and_signal(swallowing, signal.SIGTERM)
    assert (status, out) == (143, "obeyed\n")
    assert seconds < GRACE_SECONDS


@pytest.mark.slow
def test_a_signal_never_ends_what_is_being_written():
    assert run_and_signal("interrupts.hold(busy)", signal.SIGTERM)[0] is None
    assert run_and_signal("interrupts.disarm(); busy()", signal.SIGTERM)[0] is None


def test_a_process_that_hangs_up_goes_on_under_nohup():
    command = ["nohup", sys.executable, "-c", program("os.kill(os.getpid(), 1)")]
    process = subprocess.run(command, check=False, capture_output=True, text=True)
    assert process.returncode == 0
    assert process.stdout == "ready\ndone\n"


def test_what_was_there_before_is_put_back():
    def handler(*_: object) -> None: ...

    before = {number: signal.signal(number, handler) for number in SIGNALS}
    try:
        with Interrupts(lambda _: None):
            assert all(signal.getsignal(number) is not handler for number in SIGNALS)
        assert all(signal.getsignal(number) is handler for number in SIGNALS)
        assert signal.set_wakeup_fd(-1) == -1
    finally:
        for number, found in before.items():
            signal.signal(number, found)


def test_impatient_signals_say_nothing():
    body = "interrupts.worth_saving = True\n        try: time.sleep(60)\n        finally: time.sleep(1.0)  # it saves"
    command = [sys.executable, "-c", program(body)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    for _ in range(5):
        time.sleep(0.02)
        process.send_signal(signal.SIGTERM)
    out, error = process.communicate(timeout=60)
    assert (process.returncode, out, error) == (143, "obeyed\n", "")
