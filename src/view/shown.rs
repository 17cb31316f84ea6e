//! From marches to what each pixel shows, and the numbers that sum it up.

use super::View;
use super::colour::{Axis, srgb};
use super::marched::{PixelMarches, pixels};
use crate::check::truth::{Truth, Truths, ends};
use crate::compose::{Composer, deciders};
use crate::film::Image;
use crate::kernel::Status;
use crate::kernel::records::Marched;
use crate::march::is_undecided;
use crate::render::Pipeline;
use crate::shade::Size;

/// What a pixel shows.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Pixel {
    /// A number along the axis.
    Value(f64),
    /// One of the classes.
    Class(usize),
}

/// What pixels without a number have in common.
#[derive(Clone, PartialEq, Debug)]
pub struct Class {
    /// In the legend.
    pub name: String,
    /// sRGB from 0 to 1.
    pub colour: [f64; 3],
}

/// A view, ready to be coloured.
#[derive(Clone, PartialEq, Debug)]
pub struct Shown {
    /// What is shown, in which unit.
    pub title: String,
    /// Columns and rows.
    pub size: Size,
    /// Rows from the top.
    pub pixels: Vec<Pixel>,
    /// What numbers mean; nothing if there are classes only.
    pub axis: Option<Axis>,
    /// Words at the low and the high end of the axis.
    pub ends: [&'static str; 2],
    /// All classes, those without pixels too.
    pub classes: Vec<Class>,
    /// What `--stats` prints besides medians and counts: name and value.
    pub facts: Vec<(String, String)>,
}

// Okabe and Ito's colours (2008), which readers without full colour vision can distinguish, and greys.
const ORANGE: u32 = 0xe6_9f_00;
const SKY: u32 = 0x56_b4_e9;
const GREEN: u32 = 0x00_9e_73;
const YELLOW: u32 = 0xf0_e4_42;
const BLUE: u32 = 0x00_72_b2;
const VERMILION: u32 = 0xd5_5e_00;
const PURPLE: u32 = 0xcc_79_a7;
const DARK: u32 = 0x26_28_2d;
const GREY: u32 = 0x8c_8f_96;
const WHITE: u32 = 0xf2_f2_f0;
/// Colours of deciders, the most frequent one first; the rest share grey.
const DECIDERS: [u32; 7] = [BLUE, ORANGE, SKY, VERMILION, GREEN, PURPLE, YELLOW];

/// Depth errors and overshoots: the bar ends here, in footprints.
const FAR: f64 = 100.0;
/// Depth errors are laid along the bar about linearly below this.
const NEAR: f64 = 0.1;
/// Overshoots below this take the first colour.
const LEAST_OVERSHOOT: f64 = 0.01;
/// Footprints behind the surface from which a step overstepped it.
const OVERSTEPPED: f64 = 1.0;
/// Footprints of walking from which a hit was walked to: a march that believed its estimate would have stopped early.
const WALKED: f64 = 4.0;

fn class(name: &str, colour: u32) -> Class {
    Class { name: name.into(), colour: srgb(colour) }
}

/// What a view shows. `truths` must be there for [`View::Error`], of the same pixels.
pub fn show(
    view: View,
    composer: &Composer,
    pipeline: &Pipeline,
    marched: &PixelMarches,
    truths: Option<&Truths>,
) -> Shown {
    let footprint = |t: f64| pipeline.pixel.footprint(t);
    let shown = match (view, truths) {
        (View::Error, Some(truths)) => errors(marched, truths),
        (View::Overshoot | View::Error, _) => overshoots(marched, footprint),
        (View::Iterations, _) => {
            costs(marched, Marched::COLUMNS.iterations, "Iterations of all estimates of a pixel's ray")
        }
        (View::Steps, _) => costs(marched, Marched::COLUMNS.steps, "Estimates (march steps) of a pixel's ray"),
        (View::Method, _) => methods(composer, pipeline, marched),
        (View::Confidence, _) if pipeline.plan.is_certified() => proofs(marched),
        (View::Confidence, _) => confidence(marched, footprint),
    };
    shown.in_rows()
}

impl Shown {
    fn new(size: Size, title: &str, classes: Vec<Class>) -> Shown {
        let title = title.to_string();
        Shown { title, size, pixels: Vec::new(), axis: None, ends: [""; 2], classes, facts: Vec::new() }
    }

    /// Puts pixels that are in the order of marching into rows.
    fn in_rows(mut self) -> Shown {
        let marched = std::mem::take(&mut self.pixels);
        self.pixels = vec![Pixel::Class(0); marched.len()];
        for ((x, y), pixel) in pixels(self.size).into_iter().zip(marched) {
            self.pixels[y as usize * self.size.width as usize + x as usize] = pixel;
        }
        self
    }

    /// All numbers, in rows.
    pub fn values(&self) -> Vec<f64> {
        let value = |p: &Pixel| if let Pixel::Value(value) = p { Some(*value) } else { None };
        self.pixels.iter().filter_map(value).collect()
    }

    /// How many pixels are of a class.
    pub fn count(&self, class: usize) -> usize {
        self.pixels.iter().filter(|p| **p == Pixel::Class(class)).count()
    }

    /// Median, 99th percentile and maximum of the numbers' sizes; nothing if there are none.
    pub fn spread(&self) -> Option<[f64; 3]> {
        let mut sizes: Vec<f64> = self.values().into_iter().map(f64::abs).collect();
        sizes.sort_by(f64::total_cmp);
        let last = sizes.len().checked_sub(1)?;
        Some([sizes[last / 2], sizes[last * 99 / 100], sizes[last]])
    }

    /// The picture without its legend.
    pub fn plain_image(&self) -> Image {
        let mut image = Image::new(self.size);
        for (i, pixel) in self.pixels.iter().enumerate() {
            let place = (i as u32 % self.size.width, i as u32 / self.size.width);
            image.set(place, self.colour(*pixel));
        }
        image
    }

    /// The colour of a pixel, sRGB.
    pub fn colour(&self, pixel: Pixel) -> [f64; 3] {
        match (pixel, self.axis) {
            (Pixel::Value(value), Some(axis)) => axis.colour(value),
            (Pixel::Value(_), None) => srgb(GREY),
            (Pixel::Class(class), _) => self.classes[class].colour,
        }
    }

    /// Lines of a name and a value: the spread of the numbers, the classes' shares, and what else is known.
    pub fn summary(&self) -> Vec<(String, String)> {
        let mut lines = vec![("view".to_string(), self.title.clone())];
        if let Some([median, most, max]) = self.spread() {
            let sizes = if matches!(self.axis, Some(Axis::Signed { .. })) { " (sizes)" } else { "" };
            let text = format!("median {}, 99 % {}, max {}{sizes}", short(median), short(most), short(max));
            lines.push(("values".into(), text));
        }
        let all = self.pixels.len().max(1) as f64;
        for (i, class) in self.classes.iter().enumerate() {
            let count = self.count(i);
            lines.push((class.name.clone(), format!("{count} ({:.2} %)", 100.0 * count as f64 / all)));
        }
        lines.extend(self.facts.iter().cloned());
        lines
    }
}

/// Three digits, without zeros that say nothing.
fn short(value: f64) -> String {
    match value {
        0.0 => "0".into(),
        v if !(1e-3..1e5).contains(&v) => format!("{v:.2e}"),
        v if v >= 100.0 => format!("{v:.0}"),
        v if v >= 1.0 => format!("{v:.2}"),
        v => format!("{v:.4}"),
    }
}

/// Depth errors against the truth.
fn errors(marched: &PixelMarches, truths: &Truths) -> Shown {
    let classes = vec![
        class("both miss", DARK),
        class("surface missed", YELLOW),
        class("stopped where nothing is", GREEN),
        class("truth unsettled", GREY),
    ];
    let mut shown = Shown::new(marched.size, "Depth error against brute force, in footprints", classes);
    shown.axis = Some(Axis::Signed { near: NEAR, far: FAR });
    shown.ends = ["in front of the surface", "behind it"];
    let t = marched.ends().t;
    shown.pixels = (0..t.len())
        .map(|i| match (truths.depths[i], marched.status(i)) {
            (Truth::Ambiguous, _) => Pixel::Class(3),
            (Truth::Hit(truth), Status::Hit) => Pixel::Value((t[i] - truth) / truths.scale.footprint(truth)),
            (Truth::Hit(_), _) => Pixel::Class(1),
            (Truth::Miss, Status::Hit) => Pixel::Class(2),
            (Truth::Miss, _) => Pixel::Class(0),
        })
        .collect();
    let judged = truths.judge(&ends(&marched.hits, t.len()));
    let percent = |share: f64| format!("{:.2} %", 100.0 * share);
    shown.facts = vec![
        ("hits missed".into(), format!("{} of {} hits", percent(judged.missed), judged.hits)),
        ("early stops".into(), format!("{} of stops", percent(judged.early))),
        ("median depth error".into(), format!("{} footprints", short(judged.median_error))),
    ];
    shown
}

/// How far behind the surface the first step landed that crossed it.
fn overshoots(marched: &PixelMarches, footprint: impl Fn(f64) -> f64) -> Shown {
    let classes = vec![class("no hit", DARK), class("unfinished", VERMILION), class("starts inside", GREY)];
    let title = "Overshoot: how far behind the surface the crossing step landed, in footprints";
    let mut shown = Shown::new(marched.size, title, classes);
    shown.axis = Some(Axis::Log { low: LEAST_OVERSHOOT, high: FAR });
    let ends = marched.ends();
    let t = ends.t;
    shown.pixels = (0..t.len())
        .map(|i| match marched.status(i) {
            Status::Hit if ends.ray(i).begins_inside() => Pixel::Class(2),
            Status::Hit => Pixel::Value(overshoot(marched, i, footprint(t[i]))),
            Status::Miss => Pixel::Class(0),
            Status::Unfinished => Pixel::Class(1),
        })
        .collect();
    shown
}

/// Footprints between a hit and where the step that crossed the surface landed.
fn overshoot(marched: &PixelMarches, i: usize, footprint: f64) -> f64 {
    ((marched.crossing[i] - marched.ends().t[i]) / footprint).max(0.0)
}

/// A count of the march.
fn costs(marched: &PixelMarches, column: usize, title: &str) -> Shown {
    let classes = vec![class("outside the bounding sphere", DARK)];
    let mut shown = Shown::new(marched.size, title, classes);
    let (counts, steps) = (marched.hits[column].as_slice(), marched.ends().steps);
    let pixel = |i: usize| if steps[i] > 0.0 { Pixel::Value(counts[i]) } else { Pixel::Class(0) };
    shown.pixels = (0..counts.len()).map(pixel).collect();
    shown.axis = Some(Axis::fit(&shown.values()));
    let sum = |of: &[f64]| of.iter().sum::<f64>();
    let per = sum(marched.ends().iterations) / sum(steps).max(1.0);
    shown.facts = vec![("iterations".into(), format!("{per:.2} an estimate"))];
    shown
}

/// What the estimate in front of each hit came from.
fn methods(composer: &Composer, pipeline: &Pipeline, marched: &PixelMarches) -> Shown {
    let all = deciders(composer, &pipeline.plan.choices);
    let is_hit = |i: &usize| marched.status(*i) == Status::Hit;
    let number = |i: usize| (marched.decider[i] as usize).min(all.len().saturating_sub(1));
    let mut counts = vec![0usize; all.len()];
    (0..marched.decider.len()).filter(is_hit).for_each(|i| counts[number(i)] += 1);
    let mut ranked: Vec<usize> = (0..all.len()).filter(|&k| counts[k] > 0).collect();
    ranked.sort_by_key(|&k| (std::cmp::Reverse(counts[k]), k));
    let has_one = all.windows(2).all(|pair| pair[0].node == pair[1].node);
    let named = ranked.iter().zip(DECIDERS).map(|(&k, colour)| {
        let decider = &all[k];
        let form = decider.form.map_or(String::new(), |form| format!(", {}", form.name()));
        let node = if has_one { String::new() } else { format!("{}: ", decider.node) };
        class(&format!("{node}{}{form}", decider.method.name()), colour)
    });
    let mut classes = vec![class("no hit", DARK)];
    classes.extend(named);
    let others = classes.len();
    if ranked.len() > DECIDERS.len() {
        classes.push(class("others", GREY));
    }
    let mut shown = Shown::new(marched.size, "What the estimate at the hit came from", classes);
    let rank = |k: usize| ranked.iter().position(|&r| r == k).map_or(others, |place| (place + 1).min(others));
    let pixel = |i: usize| Pixel::Class(if is_hit(&i) { rank(number(i)) } else { 0 });
    shown.pixels = (0..marched.decider.len()).map(pixel).collect();
    shown
}

/// What a march of proofs has proven.
fn proofs(marched: &PixelMarches) -> Shown {
    let classes = vec![
        class("proven empty", DARK),
        class("hit, proven up to it", BLUE),
        class("undecided, hit", ORANGE),
        class("undecided, no hit", YELLOW),
        class("unfinished", VERMILION),
        class("not a number on the way", PURPLE),
    ];
    let mut shown = Shown::new(marched.size, "What the march has proven", classes);
    let Marched { last_de: last, steps, nan, .. } = marched.ends();
    let class_of = |i: usize| match (marched.status(i), is_undecided(last[i], steps[i], marched.status(i))) {
        _ if nan[i] > 0.0 => 5,
        (Status::Unfinished, _) => 4,
        (Status::Miss, false) => 0,
        (Status::Hit, false) => 1,
        (Status::Hit, true) => 2,
        (Status::Miss, true) => 3,
    };
    shown.pixels = (0..steps.len()).map(|i| Pixel::Class(class_of(i))).collect();
    shown
}

/// What a march of estimates knows about its answer; nothing of it is proven.
fn confidence(marched: &PixelMarches, footprint: impl Fn(f64) -> f64) -> Shown {
    let classes = vec![
        class("no hit", DARK),
        class("hit, settled", BLUE),
        class("hit, walked to over 4 footprints", SKY),
        class("hit, overstepped by over 1 footprint", ORANGE),
        class("starts inside", WHITE),
        class("unfinished", VERMILION),
        class("not a number on the way", PURPLE),
    ];
    let mut shown = Shown::new(marched.size, "What the march knows about its answer", classes);
    let Marched { t, t_front: front, nan, .. } = marched.ends();
    shown.pixels = (0..t.len())
        .map(|i| {
            let of = footprint(t[i]);
            Pixel::Class(match marched.status(i) {
                _ if nan[i] > 0.0 => 6,
                Status::Unfinished => 5,
                Status::Miss => 0,
                Status::Hit if marched.ends().ray(i).begins_inside() => 4,
                Status::Hit if overshoot(marched, i, of) > OVERSTEPPED => 3,
                // A walk begins at the front and ends at the last point outside.
                Status::Hit if marched.before[i] - front[i] > WALKED * of => 2,
                Status::Hit => 1,
            })
        })
        .collect();
    shown
}
