/** What the scripted world answers about people: one inspector, her passkey and her sign-in. */
const NOW = Date.now();

export const FAKE_WAYS_IN = { set_up: true, demo: true, site: "localhost" };
export const FAKE_PERSON = { person_id: "0".repeat(32), name: "M. Inspector", roles: ["inspector"] };
export const FAKE_ME = {
  person: { ...FAKE_PERSON, state: "active", passkeys: 1, oidc: false, created_ms: NOW - 40 * 86.4e6, last_seen_ms: NOW, revision: 2 },
  passkeys: [{ credential_id: "fake", name: "Duty desk", created_ms: NOW - 40 * 86.4e6, last_used_ms: NOW - 7.2e6 }],
  sign_ins: [
    {
      sign_in_id: "0".repeat(32),
      method: "passkey",
      browser: navigator.userAgent,
      created_ms: NOW - 7.2e6,
      last_seen_ms: NOW,
      expires_ms: NOW + 3.6e7,
      current: true,
    },
  ],
};
