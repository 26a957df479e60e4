"""Path Diffuser, the two-stage diffusion model; torch only here and in training.

``path_diffuser`` is the entry. Each stage has a package with the same file names:
``initial_state`` and ``trajectory``. ``core`` holds noise schedules, sampler and attention,
``inputs`` the tensors of scenes, ``checkpoints`` files of weights.
"""
