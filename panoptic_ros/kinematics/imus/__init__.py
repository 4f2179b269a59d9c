"""IMUs: sample streams and units, mountings on the body, and estimation of heading and clock offset."""
