//! Damage that keeps enough of an input's structure to reach what lies behind the reader.

use bulbfold::check::Random;

use crate::Corpus;

/// Longest input, in bytes: what a file of hostile make may have.
pub const MAX_LEN: usize = 64 << 10;

/// Numbers at the ends of every range.
const NUMBERS: [&str; 22] = [
    "0",
    "-1",
    "1e308",
    "-1e308",
    "1e-308",
    "NaN",
    "inf",
    "-inf",
    "1e999",
    "100",
    "9999999999999999999999",
    "0.0",
    "-0.0",
    "3",
    "1000",
    "0x10",
    "true",
    "\"n\"",
    "\"s\"",
    "()",
    "4294967296",
    "-2147483649",
];

/// Pieces of the languages that are read here.
const PIECES: [&str; 40] = [
    "(",
    ")",
    "[",
    "]",
    "{",
    "}",
    "\"",
    ",",
    ":",
    ";",
    "#{",
    "//",
    "/*",
    "*/",
    "\\",
    "\0",
    "é",
    "\u{202e}",
    "\u{1b}[31m",
    "Some(",
    "-",
    "1e999",
    "..",
    "${",
    "`",
    "r#\"",
    "\n",
    "\r",
    "\t",
    "=",
    "==",
    "&&",
    "?",
    "|x|",
    "||",
    "fn ",
    "let ",
    "for i in 0..9 {",
    "#define A A\n",
    "\u{feff}",
];

/// An input with one to four changes.
pub fn mutate(input: &[u8], random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    let mut bytes = input.to_vec();
    for _ in 0..1 + [0, 0, 1, 3][random.below(4)] {
        bytes = once(&bytes, random, corpus);
        bytes.truncate(MAX_LEN);
    }
    bytes
}

fn once(bytes: &[u8], random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    if bytes.is_empty() {
        return PIECES[random.below(PIECES.len())].as_bytes().to_vec();
    }
    match random.below(12) {
        0 => flipped(bytes, random),
        1 => bytes[..random.below(bytes.len())].to_vec(),
        2 => without(bytes, random),
        3 => doubled(bytes, random),
        4 => with_piece(bytes, random),
        5 => lines(bytes, random, corpus),
        6 | 7 => number(bytes, random),
        8 => word(bytes, random, corpus),
        9 => group(bytes, random, corpus),
        10 => nested(bytes, random),
        _ => joined(bytes, random, corpus),
    }
}

fn flipped(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let at = random.below(bytes.len());
    bytes[at] = if random.below(2) == 0 { bytes[at] ^ (1 << random.below(8)) } else { random.below(256) as u8 };
    bytes
}

fn without(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let at = random.below(bytes.len());
    let end = (at + 1 + random.below(30)).min(bytes.len());
    [&bytes[..at], &bytes[end..]].concat()
}

fn doubled(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let at = random.below(bytes.len());
    let part = &bytes[at..(at + 1 + random.below(60)).min(bytes.len())];
    let to = random.below(bytes.len());
    [&bytes[..to], part, &bytes[to..]].concat()
}

fn with_piece(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let at = random.below(bytes.len());
    let times = if random.below(20) == 0 { 1 + random.below(4000) } else { 1 };
    let piece = PIECES[random.below(PIECES.len())].repeat(times);
    [&bytes[..at], piece.as_bytes(), &bytes[at..]].concat()
}

/// Swaps two lines, doubles one, or takes one of another input.
fn lines(bytes: &[u8], random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    let mut lines: Vec<&[u8]> = bytes.split(|byte| *byte == b'\n').collect();
    let (a, b) = (random.below(lines.len()), random.below(lines.len()));
    match random.below(3) {
        0 => lines.swap(a, b),
        1 => lines.insert(a, lines[b]),
        _ => {
            let others: Vec<&[u8]> = corpus.pick(random).split(|byte| *byte == b'\n').collect();
            lines.insert(a, others[random.below(others.len())]);
        }
    }
    lines.join(&b'\n')
}

/// Places of maximal runs of bytes that `of` holds for.
fn runs(bytes: &[u8], of: impl Fn(u8) -> bool) -> Vec<(usize, usize)> {
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for at in (0..bytes.len()).filter(|at| of(bytes[*at])) {
        match runs.last_mut() {
            Some((_, end)) if *end == at => *end += 1,
            _ => runs.push((at, at + 1)),
        }
    }
    runs
}

fn replaced(bytes: &[u8], (from, to): (usize, usize), by: &[u8]) -> Vec<u8> {
    [&bytes[..from], by, &bytes[to..]].concat()
}

fn number(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    let numbers = runs(bytes, |byte| byte.is_ascii_digit() || byte == b'.');
    if numbers.is_empty() {
        return flipped(bytes, random);
    }
    let place = numbers[random.below(numbers.len())];
    let near = format!("{:.3}", random.range(-9.0, 9.0));
    let by = if random.below(3) == 0 { near.as_str() } else { NUMBERS[random.below(NUMBERS.len())] };
    replaced(bytes, place, by.as_bytes())
}

fn is_of_word(byte: u8) -> bool {
    byte.is_ascii_alphabetic() || byte == b'_'
}

/// A word of this input, or of another one, where another word was.
fn word(bytes: &[u8], random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    let words = runs(bytes, is_of_word);
    if words.is_empty() {
        return flipped(bytes, random);
    }
    let source = if random.below(2) == 0 { corpus.pick(random) } else { bytes };
    let others = runs(source, is_of_word);
    if others.is_empty() {
        return flipped(bytes, random);
    }
    let (from, to) = others[random.below(others.len())];
    replaced(bytes, words[random.below(words.len())], &source[from..to])
}

/// Places of bracketed groups, brackets included, with a name before them where there is one.
fn groups(bytes: &[u8]) -> Vec<(usize, usize)> {
    let (mut open, mut groups) = (Vec::new(), Vec::new());
    for (at, byte) in bytes.iter().enumerate() {
        match byte {
            b'(' | b'[' | b'{' => {
                let word = bytes[..at].iter().rev().take_while(|byte| is_of_word(**byte)).count();
                open.push(at - word);
            }
            b')' | b']' | b'}' => groups.extend(open.pop().map(|from| (from, at + 1))),
            _ => {}
        }
    }
    groups
}

/// A bracketed group of this input, or of another one, where another group was.
fn group(bytes: &[u8], random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    let source = if random.below(2) == 0 { corpus.pick(random) } else { bytes };
    let (ours, theirs) = (groups(bytes), groups(source));
    if ours.is_empty() || theirs.is_empty() {
        return doubled(bytes, random);
    }
    let (from, to) = theirs[random.below(theirs.len())];
    replaced(bytes, ours[random.below(ours.len())], &source[from..to])
}

/// A bracketed group within as many brackets as a hand would not write.
fn nested(bytes: &[u8], random: &mut Random) -> Vec<u8> {
    const WRAPS: [(&str, &str); 10] = [
        ("[", "]"),
        ("(", ")"),
        ("{", "}"),
        ("Some(", ")"),
        ("Sequence([", "])"),
        ("Repeat(times: 2, of: ", ")"),
        ("Union([", "])"),
        ("-", ""),
        ("sin(", ")"),
        ("#{a: ", "}"),
    ];
    let groups = groups(bytes);
    if groups.is_empty() {
        return doubled(bytes, random);
    }
    let (from, to) = groups[random.below(groups.len())];
    let (before, after) = WRAPS[random.below(WRAPS.len())];
    let times = [1, 2, 20, 150, 3000][random.below(5)];
    let within = [before.repeat(times).as_bytes(), &bytes[from..to], after.repeat(times).as_bytes()].concat();
    replaced(bytes, (from, to), &within)
}

/// The beginning of this input and the end of another one.
fn joined(bytes: &[u8], random: &mut Random, corpus: &Corpus) -> Vec<u8> {
    let other = corpus.pick(random);
    let from = random.below(other.len().max(1)).min(other.len());
    [&bytes[..random.below(bytes.len())], &other[from..]].concat()
}
