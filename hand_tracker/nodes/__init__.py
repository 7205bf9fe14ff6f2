"""The nodes: parameters, QoS, callbacks and publishers; no arithmetic."""
