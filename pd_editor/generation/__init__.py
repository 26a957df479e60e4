"""Generators of traffic: Path Diffuser, the rule-based lane follower, and those of users.

``path_diffuser`` is the entry of the two-stage diffusion model: ``initial_state`` and
``trajectory`` are its stages, ``core`` holds noise schedules, sampler and attention,
``inputs`` the tensors of scenes, ``checkpoints`` files of weights, ``features`` what the
networks see of a scene.
"""
