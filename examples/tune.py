"""How much to record, and which form to fit? Search a calibration's settings with Optuna (two minutes).

It records a twin before a wall and before a cylinder, fits profiles to part of the wall's readings, and
judges them on the cylinder, which no fit sees.

pip install optuna
python examples/tune.py FOLDER [TRIALS]
"""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import optuna

from realitygap import calibrate, load_profile, load_recording
from realitygap.calibration.judge import judge
from realitygap.errors import CalibrationError


def recorded(folder):
    """Recordings of twin 3 before a wall and a cylinder, made unless they exist."""
    if not (folder / "infrared-cylinder").is_dir():
        words = f"record --robot twin:3 --plan infrared --repeats 2 --out {folder}".split()
        subprocess.run([sys.executable, "-m", "realitygap", *words], check=True, stdout=subprocess.DEVNULL)
    return [load_recording(folder / f"infrared-{name}") for name in ("wall", "cylinder")]


def main(folder, trials):
    """Print who is beaten by nobody: fewest readings, smallest model error over noise; return the study."""
    wall, cylinder = recorded(Path(folder))
    base = load_profile("paper")

    def tried(trial):
        form = trial.suggest_categorical("form", ["paper", "individual", "extended"])
        every, repeats = trial.suggest_int("every", 1, 8), trial.suggest_int("repeats", 1, 2)
        kept = (wall.place() % every == 0) & (wall.repeat < repeats)
        columns = ("distance_cm", "bearing_deg", "repeat", "counts")
        part = replace(wall, **{name: getattr(wall, name)[kept] for name in columns})
        try:
            profile = calibrate([part], base, form=form).profile
        except CalibrationError as error:  # too few readings, say
            raise optuna.TrialPruned(str(error)) from None
        errors = [sensor.lit_ratio for sensor in judge(cylinder, profile).per_sensor]
        return int(kept.sum()), float(np.median(errors))

    optuna.logging.set_verbosity(optuna.logging.WARNING)
    sampler = optuna.samplers.TPESampler(seed=1, n_startup_trials=8)
    study = optuna.create_study(directions=["minimize", "minimize"], sampler=sampler)
    study.optimize(tried, n_trials=trials)
    for best in sorted({(*one.values, str(one.params)) for one in study.best_trials}):
        print("{:4.0f} readings: model error {:5.2f} times the noise, by {}".format(*best))
    return study


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 20)
