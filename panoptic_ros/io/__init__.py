"""Files, bags and messages: everything that turns bytes into records and back.

Reading checks everything and names the file; writing is atomic (a temporary file, then a rename).
"""
