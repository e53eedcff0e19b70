"""The API of a Wonderland server, for programs: `pip install wonderland-core[client]`; nothing of the server is needed.

from wonderland.client import Wonderland

with Wonderland("https://wonderland.example", client_id, client_secret) as api:
    print(api.conformance("OH-DRN-0417")["text"])
"""

from wonderland.client.api import Wonderland
from wonderland.client.errors import ApiError, TokenError, Unreachable, WebhookError
from wonderland.client.webhooks import verify_webhook

__all__ = ["ApiError", "TokenError", "Unreachable", "WebhookError", "Wonderland", "verify_webhook"]
