"""Browser viewer: one HTML page and the server that feeds it.

A scene is a bag or the live graph. It forwards ROS messages as raw CDR bytes, and the page decodes them with
the message definitions that it receives. So the server does not decode and encode messages again, and live
and recorded scenes share one path. A page layer for another topic needs no change in this package.
"""
