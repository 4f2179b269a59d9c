"""The viewer: one page in any browser, and the server that feeds it.

A scene (a bag, or the live graph) hands out messages as they are: the page decodes CDR itself, by the
definitions that it is told. So nothing is decoded and encoded again, live and recorded are one thing, and
a layer that draws another topic needs nothing here.
"""
