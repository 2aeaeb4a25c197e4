#!/usr/bin/env bash
# A store of S3 that is busy replies 503 "SlowDown". s3fs 2026.9.0 sends such a GET up to five times, with pauses.
# It looks for "SlowDown" in the text of the error. The reply to a HEAD has no body, so this word is missing, and
# s3fs sends a HEAD once. `info` sends a HEAD, and so does `cat_file` of a whole file before its GET. There only
# the attempts of botocore are left. Raise AWS_MAX_ATTEMPTS.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q s3fs==2026.9.0 fsspec==2026.9.0 aiobotocore==3.10.0 botocore==1.43.117
AWS_ACCESS_KEY_ID=a AWS_SECRET_ACCESS_KEY=b AWS_DEFAULT_REGION=us-east-1 AWS_MAX_ATTEMPTS=1 \
  "$folder/venv/bin/python" - <<'PYTHON'
from collections import Counter
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from threading import Thread

import s3fs

asked = Counter()


class Busy(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def reply(self):
        asked[self.command] += 1
        busy = asked[self.command] <= 2
        body = b"<Error><Code>SlowDown</Code><Message>later</Message></Error>" if busy else b"four"
        self.send_response(503 if busy else 200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    do_GET = do_HEAD = reply

    def log_message(self, *_):
        pass


server = ThreadingHTTPServer(("127.0.0.1", 0), Busy)
Thread(target=server.serve_forever, daemon=True).start()
store = s3fs.S3FileSystem(endpoint_url=f"http://127.0.0.1:{server.server_port}")
content = store.cat_file("bucket/name", 0, 4)
print("GET of a part:", content, "after", asked["GET"], "requests")
try:
    store.cat_file("bucket/name")
    said = "no error"
except OSError as error:
    said = f"OSError: {error}"
print("GET of the whole:", said, "after", asked["HEAD"], "HEAD")
assert content == b"four", "changed"
assert asked["GET"] == 3, "changed"
assert said.startswith("OSError"), "changed"
assert asked["HEAD"] == 1, "changed"
server.shutdown()
PYTHON
