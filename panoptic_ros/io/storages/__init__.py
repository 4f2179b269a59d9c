"""Read bag files: MCAP and SQLite3, compressed with zstd or not."""

from panoptic_ros.io.storages.opening import opened, packed_name, unpack
from panoptic_ros.io.storages.storage import ForeignTopic, Storage, is_storage, merged

__all__ = ["ForeignTopic", "Storage", "is_storage", "merged", "opened", "packed_name", "unpack"]
