"""Inference libraries: onnxruntime, and OpenVINO where onnxruntime lacks its provider."""
