// A real OpenID provider on loopback. Arguments: the client's redirect URI, and accounts by subject as JSON. Its pages
// (login, consent) are the library's own for development: any password will do.
import { createServer } from "node:http";
import Provider from "oidc-provider";

const [redirectUri, accounts] = [process.argv[2], JSON.parse(process.argv[3])];
const server = createServer();
server.listen(0, "127.0.0.1", () => {
  const issuer = `http://127.0.0.1:${server.address().port}`;
  const provider = new Provider(issuer, {
    clients: [
      {
        client_id: "wonderland",
        client_secret: "a secret of tests, with : and %",
        redirect_uris: [redirectUri],
        grant_types: ["authorization_code"],
        response_types: ["code"],
      },
    ],
    claims: { openid: ["sub"], email: ["email", "email_verified"], profile: ["name"], groups: ["groups"] },
    scopes: ["openid", "email", "profile", "groups"],
    pkce: { required: () => true },
    cookies: { keys: ["only for tests"] },
    findAccount: (_context, sub) => (sub in accounts ? { accountId: sub, claims: () => ({ sub, ...accounts[sub] }) } : undefined),
  });
  server.on("request", provider.callback());
  console.log(JSON.stringify({ issuer }));
});
