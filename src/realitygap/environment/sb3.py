"""Robots for Stable-Baselines3: its `VecEnv` over the native vector environment."""

from functools import cache
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode

from realitygap.environment.vector import RobotVectorEnv
from realitygap.errors import UsageError
from realitygap.lazy import needed

__all__ = ["stable_baselines"]

SHARED = "the robots are one compiled batch. Make another RobotVectorEnv with what it should have"


def stable_baselines(env: RobotVectorEnv) -> Any:
    """A vector environment for Stable-Baselines3's learners (extra `[sb3]`).

    At a trial's end its info has "terminal_observation", "TimeLimit.truncated" and "score".

    Args:
        env: a `RobotVectorEnv`, or what `gymnasium.make_vec` made of one, whose robots start again in the
            same step: autoreset_mode="SameStep".

    Raises:
        UsageError: another autoreset mode, or Stable-Baselines3 is not installed.
    """
    if (mode := env.metadata.get("autoreset_mode")) is not AutoresetMode.SAME_STEP:
        got = getattr(mode, "value", mode)
        raise UsageError(f"autoreset_mode: expected SameStep for Stable-Baselines3, got {got}.")
    return _adapter()(env)


@cache
def _adapter() -> Any:
    """The class, of a package that is loaded here only."""
    base: Any = needed("stable_baselines3.common.vec_env", "sb3").VecEnv

    class Robots(base):  # type: ignore[misc]
        def __init__(self, env: RobotVectorEnv) -> None:
            self.env = env
            super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

        def reset(self) -> Any:
            if any(one != self._options[0] for one in self._options):
                raise UsageError(f"options: expected the same for all robots; {SHARED}.")
            seeds = None if None in self._seeds else self._seeds
            seen, _ = self.env.reset(seed=seeds, options=self._options[0])
            self._reset_seeds()
            self._reset_options()
            return seen

        def step_async(self, actions: Any) -> None:
            self.actions = actions

        def step_wait(self) -> tuple[Any, ...]:
            seen, rewards, terminated, truncated, info = self.env.step(self.actions)
            infos: list[dict[str, Any]] = [{"TimeLimit.truncated": bool(c)} for c in truncated & ~terminated]
            for i in np.flatnonzero(terminated | truncated):
                infos[i]["terminal_observation"] = info["final_obs"][i]
                infos[i]["score"] = info["final_info"]["score"][i]
            return seen, rewards.astype(np.float32), terminated | truncated, infos

        def close(self) -> None:
            self.env.close()

        def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
            return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

        def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
            raise UsageError(f"set_attr({attr_name!r}): {SHARED}.")

        def env_method(self, method_name: str, *args: Any, indices: Any = None, **words: Any) -> list[Any]:
            raise UsageError(f"env_method({method_name!r}): {SHARED}.")

        def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
            return [False for _ in self._get_indices(indices)]

    return Robots
