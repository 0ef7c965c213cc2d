"""Stable-Baselines3's PPO on the vector environment, by an adapter that you may copy (a minute).

pip install 'realitygap[gymnasium]' stable-baselines3
python examples/learn_sb3.py [STEPS]
"""

import sys

import gymnasium
import numpy as np
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize

import realitygap.environment

gymnasium.register_envs(realitygap.environment)  # they have their names from its import
ROBOTS = 64


class Robots(VecEnv):
    """A vector environment of Gymnasium that begins anew in the same step, as Stable-Baselines3 has them."""

    def __init__(self, env):
        self.env = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)

    def reset(self):
        seeds = None if None in self._seeds else self._seeds
        seen, _ = self.env.reset(seed=seeds, options=self._options[0])
        self._reset_seeds()
        self._reset_options()
        return seen

    def step_async(self, actions):
        self.actions = actions

    def step_wait(self):
        seen, rewards, terminated, truncated, info = self.env.step(self.actions)
        infos = [{"TimeLimit.truncated": bool(cut)} for cut in truncated & ~terminated]
        for i in np.flatnonzero(terminated | truncated):
            infos[i]["terminal_observation"] = info["final_obs"][i]
            infos[i]["score"] = info["final_info"]["score"][i]
        return seen, rewards.astype(np.float32), terminated | truncated, infos

    def close(self):
        self.env.close()

    def get_attr(self, attr_name, indices=None):
        return [getattr(self.env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name, value, indices=None):
        setattr(self.env, attr_name, value)

    def env_method(self, method_name, *method_args, indices=None, **method_kwargs):
        return [getattr(self.env, method_name)(*method_args, **method_kwargs)]

    def env_is_wrapped(self, wrapper_class, indices=None):
        return [False for _ in self._get_indices(indices)]


def make(robots, name="realitygap/ObstacleAvoidance-v0"):
    """Robots of ours, for Stable-Baselines3."""
    settings = {"num_envs": robots, "vectorization_mode": "vector_entry_point", "autoreset_mode": "SameStep"}
    return Robots(gymnasium.make_vec(name, **settings))


def main(steps):
    """Learn; print and return the mean score of the last hundred trials."""
    env = VecNormalize(VecMonitor(make(ROBOTS)), norm_obs=False)  # a step's reward is a small number
    learner = PPO("MlpPolicy", env, n_steps=100, batch_size=1600, gamma=0.99, seed=1, device="cpu")
    learner.learn(steps)
    score = np.mean([trial["r"] for trial in learner.ep_info_buffer])
    print(f"after {learner.num_timesteps} steps: mean score {score:.3f} of the last trials")
    return score


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 500_000)
