"""What is exported does what the simulation did, to the bit, in the languages that it is written in."""

from __future__ import annotations

import itertools
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from realitygap.control.genotype import Genotype
from realitygap.errors import StudyError, UsageError
from realitygap.export.onboard import OnBoard, on_board, sizes, write_source
from realitygap.study.config import Condition
from realitygap.study.load import Study
from realitygap.study.runner import run_study
from realitygap.world.robot import load_profile
from tests.kernels import calls
from tests.kernels.scenes import PAPER, work_for
from tests.study.helpers import small

HERE = Path(__file__).parent
BOTH = HERE.parents[1] / "examples" / "seek_in_two_rooms.py"
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Werror")
ARDUINO = Path("/usr/share/arduino/hardware/arduino/avr")
CHIP = ("-mmcu=atmega328p", "-DF_CPU=16000000L", "-DARDUINO=10819", "-DARDUINO_ARCH_AVR", "-Os",
        "-ffunction-sections", "-fdata-sections")  # fmt: skip
RICH = Genotype.random(8, start_neurons=1.0, start_links=1.0).genes
"""As full as a genotype may be."""
WIDE = Genotype.random(8, inputs=12, start_neurons=1.0, start_links=1.0).genes
CORTEX_M4 = ("-mcpu=cortex-m4", "-mthumb", "-fno-pie", "-fstack-protector-all")
LIBRARY = {
    "ch.h": """
        #include <stdint.h>
        typedef uint32_t systime_t;
        typedef struct { int taken; } mutex_t;
        typedef struct { int heard; } condition_variable_t;
        #define MUTEX_DECL(name) mutex_t name = { 0 }
        #define CONDVAR_DECL(name) condition_variable_t name = { 0 }
        #define MS2ST(ms) ((systime_t)(ms))
        void chSysInit(void);
        void chSysHalt(const char *reason) __attribute__((noreturn));
        void chThdSleepMilliseconds(uint32_t ms);
        systime_t chVTGetSystemTime(void);
        void chThdSleepUntilWindowed(systime_t prev, systime_t next);
    """,
    "hal.h": "void halInit(void);",
    "memory_protection.h": "void mpu_init(void);",
    "motors.h": """
        void motors_init(void);
        void left_motor_set_speed(int speed);
        void right_motor_set_speed(int speed);
    """,
    "sensors/proximity.h": """
        #define FAST_UPDATE 0
        void proximity_start(uint8_t mode);
        int get_prox(unsigned int sensor_number);
        int get_ambient_light(unsigned int sensor_number);
    """,
    "msgbus/messagebus.h": """
        typedef struct { int topics; } messagebus_t;
        void messagebus_init(messagebus_t *bus, void *lock, void *condvar);
    """,
    "parameter/parameter.h": "typedef struct { int values; } parameter_namespace_t;",
}
"""What main.c asks of the e-puck2's library, declared as its headers declare it."""
STEPS = int(os.environ.get("REALITYGAP_STEPS", "1000"))
"""Of an evolved network in MicroPython, where a million take minutes; C makes a million always."""


ROBOT = """
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#include "ch.h"
#include "main.h"

static const int rows[][18] = { VECTORS };
static unsigned int step, now, asked;

void halInit(void) {}
void chSysInit(void) {}
void mpu_init(void) {}
void motors_init(void) {}
void messagebus_init(messagebus_t *bus, void *lock, void *condvar) {}
void proximity_start(uint8_t mode) {}
void chSysHalt(const char *reason) { abort(); }
void chThdSleepMilliseconds(uint32_t ms) { now += ms; }
systime_t chVTGetSystemTime(void) { return now; }
int get_prox(unsigned int sensor) { return rows[step][sensor]; }
int get_ambient_light(unsigned int sensor) { return rows[step][8 + sensor]; }

static void turn(int wheel, int speed)
{
    if (speed != rows[step][16 + wheel]) exit(1);
    asked |= 1u << wheel;
}

void left_motor_set_speed(int speed) { turn(0, speed); }
void right_motor_set_speed(int speed) { turn(1, speed); }

void chThdSleepUntilWindowed(systime_t prev, systime_t next)
{
    if (prev != now || next != now + 100 || asked != 3) exit(2);
    now = next, asked = 0;
    if (++step == sizeof rows / sizeof rows[0]) { printf("%u steps", step); exit(0); }
}
"""
"""A robot that reads the test vectors and compares what it is told."""


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Study:
    """Two short runs: one is fed by proximity, one by light."""
    return run_study(tmp_path_factory.mktemp("export") / "study", small(), workers=1)


@pytest.fixture(scope="module")
def both(tmp_path_factory) -> Study:
    """A run fed by infrared and light, of an e-puck with the paper's light sensors in its own counts."""
    folder = tmp_path_factory.mktemp("both")
    robot, paper = load_profile("e-puck"), load_profile("paper")
    lit = replace(paper.ambient, sensors=paper.ambient.sensors, top=4095.0)
    (folder / "robot.toml").write_text(replace(robot, name="lit", ambient=lit).to_toml())
    conditions = (Condition(task=str(BOTH), noise=1.0),)
    config = small(evaluations=5, profile=str(folder / "robot.toml"), conditions=conditions)
    return run_study(folder / "study", config, workers=1)


def compiler(name: str) -> str:
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"no {name} here")
    return found


def run(*words: object, given: bytes = b"", cwd: Path | None = None) -> bytes:
    """What a program prints; it must not fail."""
    done = subprocess.run(list(map(str, words)), input=given, capture_output=True, timeout=3000, cwd=cwd)
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout


def by_kernel(board: OnBoard, study: Study, genes: np.ndarray, readings: np.ndarray) -> np.ndarray:
    """Commands [steps, 2] by the simulation's own compiled scaling and network."""
    inputs = np.zeros(readings.shape, np.int64)
    first = 0
    for fed in board.channels:
        those = slice(first, first + fed.there)
        given, made = readings[:, those].astype(float), np.zeros((len(readings), fed.there), np.int64)
        calls.scale_inputs(*study.profile.channel(fed.kind).bands, given, made)
        inputs[:, those], first = made, first + fed.there
    inputs = np.ascontiguousarray(inputs[:, list(board.sensors)])
    nets = Genotype.decode(genes, inputs.shape[1])
    outputs = np.zeros((len(readings), 2), np.int64)
    calls.drive(nets, 0, inputs, work_for(PAPER, inputs=inputs.shape[1], nets=nets), outputs)
    return np.array(board.commands)[outputs + 10]


def random_readings(board: OnBoard, steps: int) -> np.ndarray:
    """int16[steps, sensors], some held for the first 400: left alone a network settles."""
    random = np.random.default_rng(len(board.channels[0].kind))
    top = np.repeat([fed.top for fed in board.channels], [fed.there for fed in board.channels])
    readings = random.integers(0, top + 1, (steps, board.there)).astype(np.int16)
    held = random.random((400, board.there)) < 0.7
    for begin in range(1, 400):
        readings[begin] = np.where(held[begin], readings[begin - 1], readings[begin])
    return readings


@pytest.mark.parametrize("which", ["proximity", "light", "both"])
def test_a_million_steps_in_c(study, both, tmp_path, which):
    """Warnings are errors, and every command of a million random steps is the kernel's; of both kinds of
    sensors fewer, to save time: their inputs alone are other."""
    cc, genes = compiler("gcc"), WIDE if which == "both" else RICH
    study = both if which == "both" else study
    board = on_board(study.runs[which == "light"], "random", genes)
    write_source(board, "c99", tmp_path)
    for file in ("controller.c", "test_controller.c"):
        run(cc, *STRICT, "-O2", "-c", tmp_path / file, "-o", tmp_path / f"{file}.o")
    run(cc, tmp_path / "controller.c.o", tmp_path / "test_controller.c.o", "-o", tmp_path / "vectors")
    assert b"200 steps as in the simulation" in run(tmp_path / "vectors")
    files = (HERE / "million.c", tmp_path / "controller.c.o")
    run(cc, *STRICT, "-O2", "-I", tmp_path, *files, "-o", tmp_path / "all")
    readings = random_readings(board, 100_000 if which == "both" else 1_000_000)
    made = np.frombuffer(run(tmp_path / "all", given=readings.tobytes()), np.int16).reshape(-1, 2)
    assert (made == by_kernel(board, study, genes, readings)).all()
    assert len(np.unique(made)) > 5


def test_every_reading_is_scaled_as_the_kernel_scales_it(study):
    """The edges give, for each count that there is, the very input of the simulation."""
    for one in study.runs:
        (board,) = on_board(one, "fittest", one.fittest).channels
        counts = np.arange(board.top + 1)
        passed = counts[:, None] >= board.edges if board.rising else counts[:, None] <= board.edges
        readings, inputs = (
            np.repeat(counts[:, None], 8, 1).astype(float),
            np.zeros((len(counts), 8), np.int64),
        )
        calls.scale_inputs(*study.profile.channel(board.kind).bands, readings, inputs)
        assert (passed.sum(1) - 10 == inputs[:, 0]).all()
    assert {on_board(one, "fittest", one.fittest).channels[0].rising for one in study.runs} == {True, False}


def test_python(study, both, tmp_path):
    """The module needs nothing but Python, and passes its test vectors: rich, without links, fed by both
    kinds of sensors, each with its own scale."""
    for one, genes in (
        (study.runs[1], RICH),
        (study.runs[1], Genotype.constant(3, -2).genes),
        (both.runs[0], WIDE),
    ):
        write_source(on_board(one, "random", genes), "micropython", str(tmp_path))
        assert b"as in the simulation" in run(sys.executable, "-c", "import test_controller", cwd=tmp_path)


def e_puck2(both: Study, folder: Path) -> tuple[OnBoard, Path]:
    """Its project's folder, and beside it what it asks of the library."""
    board = on_board(both.runs[0], "random", WIDE)
    project = write_source(board, "e-puck2", folder)[0].parent
    for name, text in LIBRARY.items():
        (folder / "library" / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / "library" / name).write_text(text)
    return board, project


def test_an_e_puck2s_project_compiles_for_its_chip(both, tmp_path):
    """Every file of it, warnings being errors, against what the library's headers declare."""
    cc, (_, project) = compiler("arm-none-eabi-gcc"), e_puck2(both, tmp_path)
    if subprocess.run([cc, "-E", "-"], input=b"#include <stdint.h>", capture_output=True).returncode:
        pytest.skip(f"{cc} has no stdint.h here")
    for file in ("main.c", "controller.c"):
        here = ("-I", project, "-I", tmp_path / "library")
        run(cc, *CORTEX_M4, *STRICT, "-O2", *here, "-c", project / file, "-o", tmp_path / "one.o")
    assert "CSRC += ./main.c ./controller.c" in (project / "makefile").read_text()


def test_an_e_puck2s_loop_drives_as_the_simulation(both, tmp_path):
    """Fed the test vectors, sensor by sensor, main.c asks its motors for their commands, a step a period."""
    cc, (board, project) = compiler("gcc"), e_puck2(both, tmp_path)
    rows = np.hstack([board.vectors.readings, board.vectors.commands]).tolist()
    vectors = ",".join(f"{{{','.join(map(str, row))}}}" for row in rows)
    (tmp_path / "robot.c").write_text(ROBOT.replace("VECTORS", vectors))
    here = ("-I", project, "-I", tmp_path / "library")
    files = (project / "main.c", project / "controller.c", tmp_path / "robot.c")
    run(cc, "-fno-stack-protector", *here, *files, "-o", tmp_path / "robot")
    assert run(tmp_path / "robot") == b"200 steps"


def test_an_e_puck2s_project_is_for_an_e_puck2(study, tmp_path):
    """A Khepera's counts and commands are not its."""
    board = on_board(study.runs[0], "random", RICH)
    with pytest.raises(StudyError, match=r"an e-puck2's eight sensors .* got 8 proximity sensors .* 1023"):
        write_source(board, "e-puck2", tmp_path)
    named = replace(board, name="main")
    with pytest.raises(UsageError, match="name: expected another name than main"):
        write_source(named, "e-puck2", tmp_path)
    assert not list(tmp_path.iterdir())


def test_micropython(study, both, tmp_path):
    """A real MicroPython passes, where there is one: node, and MICROPYTHON names npm's package."""
    node, package = compiler("node"), os.environ.get("MICROPYTHON", "")
    if not Path(package, "micropython.mjs").is_file():
        pytest.skip("MICROPYTHON names no folder of npm's @micropython/micropython-webassembly-pyscript")
    pairs = itertools.product(study.runs, ("fittest", "random"))
    for one, who in (*pairs, (both.runs[0], "random")):
        genes = one.fittest if who == "fittest" else WIDE if one in both.runs else RICH
        board = on_board(one, who, genes)
        write_source(board, "micropython", tmp_path)
        readings = random_readings(board, STEPS if who == "fittest" else 1000)
        (tmp_path / "readings").write_bytes(readings.tobytes())
        said = run(node, HERE / "micropython.mjs", package, tmp_path).decode()
        assert said.split("\n")[0] == "micropython" and "200 steps as in the simulation" in said
        made = np.frombuffer((tmp_path / "commands").read_bytes(), np.int16).reshape(-1, 2)
        assert (made == by_kernel(board, one.study, genes, readings)).all()


def test_arduino(study, both, tmp_path):
    """The sketch's folder becomes an Uno's program as it is, with Arduino's core; its size is told. Of both
    kinds of sensors the sketch is a Mega's."""
    cxx = compiler("avr-g++")
    _, source, sketch = write_source(on_board(study.runs[0], "random", RICH), "arduino", tmp_path)
    assert sketch == tmp_path / "controller" / "controller.ino"
    size = sizes(source)["ATmega328P"]
    assert 500 < size < 4000
    if not ARDUINO.is_dir():
        pytest.skip(f"no Arduino core in {ARDUINO}")
    core, objects = ARDUINO / "cores" / "arduino", []
    of_core = [
        core / name for name in ("wiring.c", "wiring_digital.c", "wiring_analog.c", "hooks.c", "main.cpp")
    ]
    for file in (source, *of_core, sketch):
        objects.append(tmp_path / f"{file.name}.o")
        tongue = ("-x", "c", "-std=gnu11") if file.suffix == ".c" else ("-x", "c++")
        strict = () if file in of_core else ("-Wall", "-Wextra", "-Werror")
        ours = ("-include", "Arduino.h") if file.suffix == ".ino" else ()
        where = ("-I", core, "-I", ARDUINO / "variants" / "standard")
        run(cxx, *CHIP, *where, *strict, *ours, *tongue, "-c", file, "-o", objects[-1])
    run(cxx, *CHIP, "-Wl,--gc-sections", *objects, "-o", tmp_path / "sketch.elf")
    text, data, bss = map(int, run("avr-size", tmp_path / "sketch.elf").splitlines()[1].split()[:3])
    assert text + data < 32_256 and data + bss < 2048 - 256  # an Uno's, with room for the stack
    sketch = write_source(on_board(both.runs[0], "random", WIDE), "arduino", tmp_path / "mega")[-1]
    mega = ("-mmcu=atmega2560", *CHIP[1:], "-I", core, "-I", ARDUINO / "variants" / "mega")  # sixteen pins
    run(cxx, *mega, "-Wall", "-Wextra", "-Werror", *ours, "-x", "c++", "-c", sketch, "-o", objects[0])


def test_another_robot(tmp_path):
    """An e-puck's counts, up to 4095, and its commands, hundreds of units, are exported in its own scale."""
    e_puck = load_profile("e-puck")
    config = replace(
        small(evaluations=5, profile="e-puck"), conditions=(Condition(task="avoidance", noise=1.0),)
    )
    one = run_study(tmp_path / "study", config, workers=1).runs[0]
    board = on_board(one, "random", RICH)
    assert (board.channels[0].top, board.commands[-1]) == (4095, round(e_puck.wheels.top_command))
    write_source(board, "micropython", tmp_path)
    assert (board.vectors.readings.max(), np.abs(board.vectors.commands).max()) > (2000, 100)
    run(sys.executable, "-c", "import test_controller", cwd=tmp_path)
