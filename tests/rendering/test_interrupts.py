"""A signal acts within seconds even if the main thread is busy, and never loses what was rendered."""

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

def give_up(status, unfinished):
    print(unfinished, flush=True)
    os._exit(status)

wrt.cli.signals.give_up = give_up

def busy(rounds=1 << 30):
    hashlib.pbkdf2_hmac("sha256", b"", b"", rounds)

with Interrupts("given up", own_process=True) as interrupts:
    print("ready", flush=True)
    try:
        {body}
    except KeyboardInterrupt:
        print("obeyed", flush=True)
        sys.exit(interrupts.exit_status)
print("done", flush=True)
"""


def program(body):
    return [sys.executable, "-c", PROGRAM.replace("{body}", body).replace("{grace}", str(GRACE_SECONDS))]


def started(body):
    process = subprocess.Popen(program(body), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "ready\n"
    return process


def run_and_signal(body, number):
    """Return status, output after the signal, and seconds until the program's end; None if it kept running."""
    process = started(body)
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


SWALLOWING = "exec('try: time.sleep(5)\\nexcept BaseException: pass'); interrupts.check(); time.sleep(60)"


@pytest.mark.parametrize(
    ("body", "number"),
    [
        *(("time.sleep(60)", number) for number in SIGNALS),
        (SWALLOWING, signal.SIGTERM),  # a signal that a library swallows is found all the same
    ],
)
def test_a_signal_during_pythons_own_work_is_obeyed_at_once(body, number):
    status, out, seconds = run_and_signal(body, number)
    assert (status, out) == (128 + number, "obeyed\n")
    assert seconds < GRACE_SECONDS


@pytest.mark.slow
@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_while_a_library_works_ends_what_has_nothing_to_save(number):
    status, out, seconds = run_and_signal("busy()", number)
    assert (status, out) == (128 + number, "given up\n")
    assert seconds > GRACE_SECONDS


@pytest.mark.slow
@pytest.mark.parametrize(
    "body", ["interrupts.worth_saving = True; busy()", "interrupts.hold(busy)", "interrupts.disarm(); busy()"]
)
def test_a_signal_never_ends_what_is_worth_saving_or_being_written(body):
    assert run_and_signal(body, signal.SIGTERM)[0] is None


def test_a_process_that_hangs_up_goes_on_under_nohup():
    command = ["nohup", *program("os.kill(os.getpid(), 1)")]
    process = subprocess.run(command, check=False, capture_output=True, text=True)
    assert (process.returncode, process.stdout) == (0, "ready\ndone\n")


def test_what_was_there_before_is_put_back():
    def handler(*_): ...

    before = {number: signal.signal(number, handler) for number in SIGNALS}
    try:
        with Interrupts("", own_process=True):
            assert all(signal.getsignal(number) is not handler for number in SIGNALS)
        assert all(signal.getsignal(number) is handler for number in SIGNALS)
        assert signal.set_wakeup_fd(-1) == -1
    finally:
        for number, found in before.items():
            signal.signal(number, found)


def test_impatient_signals_say_nothing():
    process = started("interrupts.worth_saving = True\n        try: time.sleep(60)\n        finally: time.sleep(1.0)")
    for _ in range(5):
        time.sleep(0.02)
        process.send_signal(signal.SIGTERM)
    out, error = process.communicate(timeout=60)
    assert (process.returncode, out, error) == (143, "obeyed\n", "")
