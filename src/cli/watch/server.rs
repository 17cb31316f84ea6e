//! The page: served to this machine alone, under an address that nobody guesses.
//!
//! Everything lies below `/TOKEN/`: the page itself, `state?after=N` (answered when there is something newer, or after a while), `picture` (RGBA, row by
//! row), and the orders `move`, `set`, `preset` and `write`, which are posted as JSON.

use std::io::{Cursor, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use bulbfold::live::Movement;
use serde::Deserialize;
use tiny_http::{Header, Method, Request, Response, Server};

use super::desk::Desk;

/// The page.
const PAGE: &str = include_str!("page.html");
/// How long a question for news waits.
const PATIENCE: Duration = Duration::from_secs(20);
/// Most bytes of an order.
const MOST_BYTES: u64 = 64 * 1024;
/// Most questions that are answered at a time.
const MOST_THREADS: usize = 64;

/// An order of the page.
#[derive(Deserialize)]
#[serde(rename_all = "snake_case")]
enum Order {
    /// Moves the camera; more will come at once where `is_moving`.
    Move { movement: Movement, is_moving: bool },
    /// Moves a number.
    Set { path: String, value: f64, is_moving: bool },
    /// Shows a preset, or the file's own view.
    Preset(Option<String>),
    /// Writes what was moved into the file.
    Write,
}

/// What answers are made of.
type Answer = Response<Cursor<Vec<u8>>>;

/// Serves the page from now on, and returns its address.
pub fn start(desk: Arc<Desk>, port: u16) -> std::io::Result<String> {
    let server = Server::http(("127.0.0.1", port)).map_err(std::io::Error::other)?;
    let port = server.server_addr().to_ip().map_or(port, |address| address.port());
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(|error| std::io::Error::other(error.to_string()))?;
    let token: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    let address = format!("http://127.0.0.1:{port}/{token}/");
    let site = Arc::new(Site { desk, token, hosts: [format!("127.0.0.1:{port}"), format!("localhost:{port}")] });
    std::thread::spawn(move || {
        let busy = Arc::new(AtomicUsize::new(0));
        for request in server.incoming_requests() {
            if busy.fetch_add(1, Ordering::AcqRel) >= MOST_THREADS {
                busy.fetch_sub(1, Ordering::AcqRel);
                let _ = request.respond(refused(503, "too many questions at a time"));
                continue;
            }
            let (site, busy) = (site.clone(), busy.clone());
            std::thread::spawn(move || {
                site.answer(request);
                busy.fetch_sub(1, Ordering::AcqRel);
            });
        }
    });
    Ok(address)
}

struct Site {
    desk: Arc<Desk>,
    token: String,
    /// What browsers call this server; a page of another name that leads here has no business with it.
    hosts: [String; 2],
}

impl Site {
    fn answer(&self, mut request: Request) {
        let answer = self.answered(&mut request);
        // A browser that has gone needs no answer.
        let _ = request.respond(answer);
    }

    fn answered(&self, request: &mut Request) -> Answer {
        let is_ours = header(request, "Host").is_some_and(|host| self.hosts.contains(&host));
        let origin = header(request, "Origin");
        let is_own_page = origin.is_none_or(|origin| self.hosts.iter().any(|host| origin == format!("http://{host}")));
        if !is_ours || !is_own_page {
            return refused(403, "this page is for its own machine");
        }
        let url = request.url().to_string();
        let Some(path) = url.strip_prefix('/').and_then(|url| url.strip_prefix(&self.token[..])) else {
            return refused(404, "the address has a token, which `bulbfold watch` prints");
        };
        let (path, query) = path.split_once('?').unwrap_or((path, ""));
        match (request.method(), path) {
            (Method::Get, "/") => said("text/html; charset=utf-8", PAGE.as_bytes().to_vec()),
            (Method::Get, "/state") => {
                let after = query.strip_prefix("after=").and_then(|number| number.parse().ok()).unwrap_or(0);
                let told = serde_json::to_vec(&self.desk.told(after, PATIENCE)).unwrap_or_default();
                said("application/json", told)
            }
            (Method::Get, "/picture") => self.picture(),
            (Method::Post, "/order") => self.ordered(request),
            _ => refused(404, "there is no such page"),
        }
    }

    /// The last picture: its columns and rows as two numbers of four bytes, then RGBA.
    fn picture(&self) -> Answer {
        let Some(image) = self.desk.picture() else { return refused(404, "there is no picture yet") };
        let mut bytes = Vec::with_capacity(8 + image.rgb.len() / 3 * 4);
        bytes.extend(image.size.width.to_le_bytes());
        bytes.extend(image.size.height.to_le_bytes());
        image.rgb.chunks_exact(3).for_each(|rgb| bytes.extend([rgb[0], rgb[1], rgb[2], 255]));
        said("application/octet-stream", bytes)
    }

    fn ordered(&self, request: &mut Request) -> Answer {
        let mut text = Vec::new();
        if request.as_reader().take(MOST_BYTES).read_to_end(&mut text).is_err() {
            return refused(400, "the order cannot be read");
        }
        let done = match serde_json::from_slice(&text) {
            Ok(Order::Move { movement, is_moving }) => self.desk.move_camera(movement, is_moving),
            Ok(Order::Set { path, value, is_moving }) => self.desk.set(&path, value, is_moving),
            Ok(Order::Preset(name)) => self.desk.take_preset(name),
            Ok(Order::Write) => self.desk.write(),
            Err(error) => Err(format!("no such order: {error}")),
        };
        match done {
            Ok(()) => said("text/plain; charset=utf-8", Vec::new()),
            Err(why) => refused(400, &why),
        }
    }
}

fn header(request: &Request, name: &'static str) -> Option<String> {
    let found = request.headers().iter().find(|header| header.field.equiv(name));
    found.map(|header| header.value.as_str().to_string())
}

fn said(kind: &str, bytes: Vec<u8>) -> Answer {
    let lines = [
        ("Content-Type", kind),
        ("Cache-Control", "no-store"),
        ("X-Content-Type-Options", "nosniff"),
        ("Referrer-Policy", "no-referrer"),
        (
            "Content-Security-Policy",
            "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'; img-src data: blob:",
        ),
    ];
    let headers = lines.into_iter().filter_map(|(name, value)| Header::from_bytes(name, value).ok());
    headers.fold(Response::from_data(bytes), Response::with_header)
}

fn refused(code: u16, why: &str) -> Answer {
    said("text/plain; charset=utf-8", why.as_bytes().to_vec()).with_status_code(code)
}
