"""Studies of persons with few views, occlusion and changes of identity."""
