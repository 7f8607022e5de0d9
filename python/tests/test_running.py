"""While a job runs: progress, other threads, Ctrl-C; and what is left after a hundred."""

import io
import os
import signal
import subprocess
import sys
import threading
import time
import types

import bench
import deacal
import pytest
from deacal import _show


def second_long(**options):
    """Takes about a second."""
    return deacal.fit_film(bench.TWIN / "symmetric", starts=60, **options)


def long_fit(recordings, **options):
    """Takes many seconds unless it is ended."""
    return deacal.fit_robot(recordings, branches=8, starts=900, **options)


def long_diagnosis(recordings, **options):
    """Takes seconds unless it is ended."""
    return deacal.diagnose(recordings, **options)


@pytest.mark.parametrize("job", [long_fit, long_diagnosis])
def test_ctrl_c_ends_a_call_within_half_a_second_and_its_work_soon_after(job, rubbing):
    sent = []

    def interrupt():
        time.sleep(0.5)
        sent.append(time.perf_counter())
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        job(rubbing, progress=False)
    took = time.perf_counter() - sent[0]
    thread.join()
    print(f"{job.__name__}: ended {1e3 * took:.0f} ms after Ctrl-C")
    assert took < 0.5
    # nothing goes on behind the caller's back
    time.sleep(1.0)
    before = time.process_time()
    time.sleep(1.0)
    assert time.process_time() - before < 0.2


def test_the_interpreter_is_free_meanwhile():
    counted, over = [0], threading.Event()

    def count():
        while not over.wait(0.001):
            counted[0] += 1

    thread = threading.Thread(target=count)
    thread.start()
    begun = time.perf_counter()
    deacal.fit_film(bench.TWIN / "symmetric", branches=3, starts=3, progress=False)
    took = time.perf_counter() - begun
    over.set()
    thread.join()
    assert counted[0] > 20 * took, f"{counted[0]} turns in {took:.2f} s"


def test_two_threads_fit_at_once():
    found = {}

    def work(name):
        found[name] = bench.ON_DATA[name][1]()

    threads = [threading.Thread(target=work, args=[name]) for name in ["film", "coupon"]]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for name, fit in found.items():
        assert fit.json == bench.fitted(name).json
    assert len(found) == 2


def test_a_callback_is_told_what_is_done_and_how_far_it_is():
    told = []
    second_long(progress=lambda *now: told.append(now))
    assert told and all(isinstance(text, str) for text, _ in told)
    shares = [share for text, share in told if text.startswith("fitting")]
    assert shares and all(0.0 <= share <= 1.0 for share in shares)
    assert told[-1][1] == 1.0


def test_what_a_callback_raises_ends_the_job():
    class Enough(Exception):
        pass

    def enough(text, share):
        raise Enough(text)

    begun = time.perf_counter()
    with pytest.raises(Enough, match="."):
        long_fit(bench.TWIN / "symmetric", progress=enough)
    assert time.perf_counter() - begun < 10.0


def test_a_terminal_shows_a_line_and_clears_it(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    second_long()
    shown = terminal.getvalue()
    assert "fitting" in shown and "% done" in shown
    assert shown.endswith("\r") and shown.rsplit("\r", 2)[1].strip() == ""
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    assert _show.line() is None


def test_a_notebook_shows_one_output_that_changes(monkeypatch):
    class Handle:
        def __init__(self):
            self.seen = []

        def update(self, data, raw):
            assert raw
            self.seen.append(data["text/plain"])

    handle = Handle()

    def display(data, raw, display_id):
        assert raw and display_id
        handle.seen.append(data["text/plain"])
        return handle

    ipython = types.ModuleType("IPython")
    ipython.get_ipython = lambda: types.SimpleNamespace(kernel=object())
    ipython.display = types.ModuleType("IPython.display")
    ipython.display.display = display
    monkeypatch.setitem(sys.modules, "IPython", ipython)
    monkeypatch.setitem(sys.modules, "IPython.display", ipython.display)
    line = _show.line()
    line("fitting", 0.25)
    line("writing", None)
    line.close()
    assert handle.seen == ["fitting, 25 % done", "writing", ""]


def resident():
    """Memory of this process, bytes."""
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.skipif(not os.path.exists("/proc/self/statm"), reason="needs /proc")
def test_a_hundred_calls_leak_nothing(truth):
    def round_of_calls():
        recording = deacal.read(bench.COUPON)
        recording["stress"].sum()
        fit = deacal.fit_coupon(recording, branches=1)
        len(fit._repr_html_())
        len(fit.json)
        deacal.predict(recording, fit, "force")["stretch"].sum()
        deacal.simulate(bench.RIG, truth, drive=bench.SINE, duration=0.5)["z_mm"].sum()
        with pytest.raises(deacal.DeacalError):
            deacal.fit_film(recording)

    for _ in range(25):
        round_of_calls()
    before = resident()
    for _ in range(100):
        round_of_calls()
    grown = resident() - before
    print(f"a hundred rounds of calls: {grown / 1024:+.0f} KiB")
    # one report a round would be tens of MB
    assert grown < 4 << 20


def test_importing_takes_no_time():
    code = "import time; t = time.perf_counter(); import deacal; print(time.perf_counter() - t)"
    words = [sys.executable, "-c", code]
    took = [float(subprocess.run(words, capture_output=True, check=True).stdout) for _ in range(5)]
    print(f"import deacal: {1e3 * min(took):.0f} ms")
    assert min(took) < 0.3
