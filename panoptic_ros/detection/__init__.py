"""Images to 2D people and score maps, one view at a time.
"""
