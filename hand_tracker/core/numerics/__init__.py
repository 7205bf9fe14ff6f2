"""Numerics below the method, used by every step.

In reading order: `jit` (kernels, compiled or plain Python), `kernel_compiler` (those that others
call as parts of these), `kernel_cache` (compiled ones on disk), `packs` (many arrays as one
argument of a kernel), `stack_memory` (scratch arrays of kernels), `vectors` (three-vectors and
frames), `quaternion` (unit quaternions, transforms for TF), `cholesky` (small linear systems),
`rigid_fit` (pose of a point set), `variable_turn` (motion at a turn rate), `assignment`
(least-cost assignment), `running_quantile` (estimate of a quantile), `differences` (their size
tells noise), `sampling` (frames that stand for many).
"""
