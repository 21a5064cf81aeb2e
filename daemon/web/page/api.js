// Requests to the daemon's HTTP interface.

/** Throws an Error with the daemon's message if the request fails. */
export async function get(path) {
  return read(await fetch(path));
}

export async function post(path, token) {
  return read(await fetch(path, { method: "POST", headers: { Authorization: `Bearer ${token}` } }));
}

async function read(response) {
  const body = await response.json().catch(() => ({ error: response.statusText }));
  if (!response.ok) throw new Error(body.error);
  return body;
}
