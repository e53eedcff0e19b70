"""A time-stamping service: OpenSSL's own, behind a small HTTP server."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

OPENSSL = shutil.which("openssl")
SETTINGS = """
[tsa]
default_tsa = service
[service]
serial = {directory}/serial
signer_digest = sha256
default_policy = 1.2.3.4.1
digests = sha256, sha512
accuracy = secs:1
ess_cert_id_chain = no
ess_cert_id_alg = sha256
[root]
basicConstraints = critical, CA:true
keyUsage = critical, keyCertSign
[signer]
basicConstraints = CA:false
extendedKeyUsage = critical, {usage}
[req]
distinguished_name = name
[name]
"""


def openssl(*arguments, **more):
    subprocess.run([OPENSSL, *map(str, arguments)], check=True, capture_output=True, timeout=30, **more)


class Service:
    """Keys and certificates in a directory; `url` while it is served."""

    def __init__(self, directory, usage="timeStamping", key=("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256")):
        self.directory = directory
        self.settings = directory / "settings.cnf"
        self.settings.write_text(SETTINGS.format(directory=directory, usage=usage))
        (directory / "serial").write_text("01\n")
        root, signer = directory / "root", directory / "signer"
        common = ("-config", self.settings, "-nodes", "-days", "30")
        new = ("req", "-x509", *key)
        openssl(
            *new, *common, "-subj", "/CN=root", "-extensions", "root", "-keyout", f"{root}.key", "-out", f"{root}.pem"
        )
        issued = ("-CA", f"{root}.pem", "-CAkey", f"{root}.key", "-extensions", "signer")
        openssl(*new, *common, *issued, "-subj", "/CN=tsa", "-keyout", f"{signer}.key", "-out", f"{signer}.pem")
        self.root = directory / "root.pem"
        self.url = ""

    def reply(self, query):
        """A TimeStampResp (DER)."""
        question, answer = self.directory / "query.tsq", self.directory / "reply.tsr"
        question.write_bytes(query)
        signer = ("-signer", self.directory / "signer.pem", "-inkey", self.directory / "signer.key")
        openssl("ts", "-reply", "-config", self.settings, "-queryfile", question, *signer, "-out", answer)
        return answer.read_bytes()

    @contextlib.contextmanager
    def served(self, answer=None, encoding=None):
        service = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self):
                query = self.rfile.read(int(self.headers["Content-Length"]))
                body = service.reply(query) if answer is None else answer
                self.send_response(200)
                self.send_header("Content-Type", "application/timestamp-reply")
                self.send_header("Content-Length", str(len(body)))
                if encoding is not None:
                    self.send_header("Content-Encoding", encoding)
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, *_):
                pass

        with HTTPServer(("127.0.0.1", 0), Handler) as server:
            thread = threading.Thread(target=server.serve_forever, args=(0.05,))
            thread.start()
            self.url = f"http://127.0.0.1:{server.server_port}/"
            try:
                yield self
            finally:
                server.shutdown()
                thread.join()
