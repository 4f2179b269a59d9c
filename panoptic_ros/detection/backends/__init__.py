"""Libraries that run networks; onnxruntime is the one."""
