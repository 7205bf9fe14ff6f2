"""The nodes: parameters, QoS, callbacks, publishers; no arithmetic but the fast path's kernels."""
