"""Bytes in, columns out, and back: what stands between a payload and the core, as the rest of the service uses it.

``batch_decoder``, ``report_shapes`` and ``batch_columns`` read report batches, ``batch_encoder`` writes them for
sensors; ``point_encoder`` writes fused points, ``point_decoder`` reads them for consumers; ``replies`` writes the rest.
"""

from aeroskein_service.batch_columns import DecodedBatch, Gathered, decode_batch, gather
from aeroskein_service.batch_decoder import OpenBatch, media_type, open_batch
from aeroskein_service.batch_encoder import encode_batch, reports_of
from aeroskein_service.messages import CONTENT_TYPES
from aeroskein_service.point_decoder import MessageError, decode_feed, decode_point
from aeroskein_service.point_encoder import PointEncoder, encode_feed
from aeroskein_service.replies import encode_message, encode_registration, encode_reports_reply, encode_tracks_reply

__all__ = [
    "CONTENT_TYPES",
    "DecodedBatch",
    "Gathered",
    "MessageError",
    "OpenBatch",
    "PointEncoder",
    "decode_batch",
    "decode_feed",
    "decode_point",
    "encode_batch",
    "encode_feed",
    "encode_message",
    "encode_registration",
    "encode_reports_reply",
    "encode_tracks_reply",
    "gather",
    "media_type",
    "open_batch",
    "reports_of",
]
