//! Cost against error: every candidate a dot, each method a line over its step multipliers.

use std::fmt::Write as _;

use super::drawing::{Drawing, GREY, INK, Item, PALE, PAPER, Point, Text};
use super::labels::{Label, Obstacles, place};
use super::scale::{Panel, Words, nanoseconds, percent, plain};
use super::{Family, MARGIN, WIDTH, caption, method_name, target_words};
use crate::check::Target;
use crate::check::measure::{Candidate, Measured, pareto};
use crate::film::Image;
use crate::graph::{LEAST_STEP, Method};
use crate::shade::Size;

/// Heading of [`CostChart::csv`].
pub const CSV_HEADER: &str = "formula,width,height,rays,hits,ambiguous,method,form,fudge,least_step,backend,precision,ns_per_pixel,\
estimates_per_pixel,missed,early,median_error_footprints,unfinished,nan,pareto,auto";

/// Everything on one formula's chart.
pub struct CostChart {
    /// Name of the fractal.
    pub formula: String,
    /// Size of the picture whose rays were sampled.
    pub size: Size,
    /// Rays sampled.
    pub rays: usize,
    /// Of them, rays with a settled hit.
    pub hits: usize,
    /// Of them, rays whose truth did not settle.
    pub ambiguous: usize,
    /// What was measured; every candidate's form is known.
    pub points: Vec<(Candidate, Measured)>,
    /// Which of them `auto` takes.
    pub auto: usize,
    /// The fractal in the same view.
    pub picture: Image,
}

/// A method on a target, with the points of its line in the order of their multipliers.
struct Curve {
    method: Option<Method>,
    target: Target,
    points: Vec<usize>,
}

/// What a panel shows of a measurement.
type Reading = fn(&Measured) -> f64;

impl CostChart {
    fn curves(&self) -> Vec<Curve> {
        let mut curves: Vec<Curve> = Vec::new();
        // Other shortest steps than the usual are not on the curves over the multiplier.
        let usual = self.points.iter().enumerate().filter(|(_, (candidate, _))| candidate.least_step.is_none());
        for (i, (candidate, _)) in usual {
            let (method, target) = (candidate.method, candidate.target);
            match curves.iter_mut().find(|c| c.method == method && c.target == target) {
                Some(curve) => curve.points.push(i),
                None => curves.push(Curve { method, target, points: vec![i] }),
            }
        }
        for curve in &mut curves {
            curve.points.sort_by(|&a, &b| self.points[a].0.fudge.total_cmp(&self.points[b].0.fudge));
        }
        curves
    }

    fn read(&self, cost: Reading, error: Reading) -> Vec<(f64, f64)> {
        self.points.iter().map(|(_, m)| (cost(m), error(m))).collect()
    }

    /// Indices of the candidates that nothing beats in time and wrong hits.
    fn front(&self) -> Vec<usize> {
        pareto(&self.read(|m| m.ns_per_pixel, Measured::wrong))
    }

    /// The chart.
    pub fn drawing(&self) -> Drawing {
        let title = format!("{}: cost against error of every distance estimate", self.formula);
        let mut page = Drawing::new(WIDTH, 872.0, title);
        self.heading(&mut page);
        self.main_panel(&mut page);
        self.key(&mut page);
        self.small_panels(&mut page);
        self.notes(&mut page);
        page
    }

    fn heading(&self, page: &mut Drawing) {
        page.text(Text::new([MARGIN, 44.0], self.formula.clone(), 26.0).bold());
        page.text(Text::new([MARGIN, 70.0], "What distance estimates cost, and how often they are wrong", 15.0));
        caption(page, &self.finding(), [MARGIN, 94.0], 660.0, 13.0);
        let place =
            [716.0, 24.0, 216.0, 216.0 * f64::from(self.picture.size.height) / f64::from(self.picture.size.width)];
        page.items.push(Item::Picture(place, self.picture.clone()));
    }

    /// What `auto` takes, and what finite differences cost beside it.
    fn finding(&self) -> String {
        let (candidate, auto) = &self.points[self.auto];
        let mut text = format!(
            "auto takes {} at fudge {}, with steps down to 1/{} of the hit threshold: {} a pixel, {} of hits wrong.",
            method_name(candidate.method),
            plain(candidate.fudge),
            plain((1.0 / candidate.least_step.unwrap_or(LEAST_STEP)).round()),
            nanoseconds(auto.ns_per_pixel),
            percent(auto.wrong())
        );
        let is_difference = |c: &Candidate| Family::of(c.method) == Family::Differences;
        if !is_difference(candidate) {
            let rivals = || self.points.iter().filter(|(c, _)| is_difference(c) && c.target == candidate.target);
            let as_right = rivals().filter(|(_, m)| m.wrong() <= auto.wrong());
            let cheapest = as_right.map(|(_, m)| m.ns_per_pixel / auto.ns_per_pixel).reduce(f64::min);
            let same = rivals().find(|(c, _)| c.fudge == candidate.fudge && c.method == Some(Method::Delta));
            if let Some((_, delta)) = same {
                let ratio = plain((delta.ns_per_pixel / auto.ns_per_pixel * 10.0).round() / 10.0);
                let _ = write!(
                    text,
                    " At the same fudge, delta costs {ratio} times as much and is wrong at {}.",
                    percent(delta.wrong())
                );
            }
            text.push_str(&match cheapest {
                Some(ratio) => format!(
                    " To be as right, finite differences cost {} times as much.",
                    plain((ratio * 10.0).round() / 10.0)
                ),
                None if rivals().next().is_some() => {
                    " No finite difference is as right at any fudge tried.".to_string()
                }
                None => String::new(),
            });
        }
        text
    }

    fn main_panel(&self, page: &mut Drawing) {
        let points = self.read(|m| m.ns_per_pixel, Measured::wrong);
        let panel = Panel::fit(&points, [92.0, 164.0, 690.0, 540.0]);
        let x = Words { title: "time per pixel, one core; less is better".into(), label: nanoseconds };
        let y = Words { title: "missed + early, share of hits; less is better".into(), label: percent };
        panel.frame(page, &x, &y, 13.0);
        let places: Vec<Point> = points.iter().map(|p| panel.at(*p)).collect();
        let front: Vec<Point> = self.front().into_iter().map(|i| places[i]).collect();
        page.line(&front, PALE, 7.0);
        let mut obstacles = Obstacles::default();
        self.draw_curves(page, &places, 1.0);
        let curves = self.curves();
        for curve in &curves {
            for pair in curve.points.windows(2) {
                obstacles.line(places[pair[0]], places[pair[1]]);
            }
        }
        places.iter().for_each(|p| obstacles.point(*p, 9.0));
        let auto = places[self.auto];
        page.items.push(Item::Ring { centre: auto, diameter: 19.0, colour: INK, width: 2.0 });
        obstacles.point(auto, 23.0);
        let mut labels = vec![Label { text: "auto".into(), anchors: vec![auto], colour: INK, bold: true }];
        if let [_, middle @ .., _] = front.as_slice()
            && let Some(corner) = middle.first().or(front.first())
        {
            labels.push(Label { text: "Pareto front".into(), anchors: vec![*corner], colour: GREY, bold: false });
        }
        labels.extend(curves.iter().map(|curve| Label {
            text: method_name(curve.method).into(),
            anchors: curve.points.iter().rev().map(|&i| places[i]).collect(),
            colour: Family::of(curve.method).colour(),
            bold: false,
        }));
        place(page, &labels, obstacles, panel.edges, 13.0);
    }

    /// Lines over the multipliers, then dots: full for f32 on the CPU, open for f64, with a dark heart for the GPU.
    fn draw_curves(&self, page: &mut Drawing, places: &[Point], scale: f64) {
        let curves = self.curves();
        for curve in &curves {
            let line: Vec<Point> = curve.points.iter().map(|&i| places[i]).collect();
            page.line(&line, Family::of(curve.method).colour(), 1.4 * scale);
        }
        // Dots of one kind are one item, which keeps files small.
        for family in Family::ALL {
            for target in [Target::CPU_F64, Target::CPU_F32, Target::Gpu] {
                for (is_whole, diameter) in [(false, 6.5 * scale), (true, 10.0 * scale)] {
                    let wanted = |(c, _): &(Candidate, Measured)| {
                        Family::of(c.method) == family && c.target == target && (c.fudge >= 1.0) == is_whole
                    };
                    let here = self.points.iter().zip(places).filter(|(point, _)| wanted(point));
                    let at: Vec<Point> = here.map(|(_, place)| *place).collect();
                    if !at.is_empty() {
                        dots(page, &at, diameter, target, family.colour());
                    }
                }
            }
        }
    }

    fn key(&self, page: &mut Drawing) {
        let mut y = 174.0;
        let size = 12.5;
        let left = 724.0;
        for family in Family::ALL {
            if self.points.iter().any(|(c, _)| Family::of(c.method) == family) {
                page.line(&[[left, y], [left + 20.0, y]], family.colour(), 3.0);
                page.text(Text::new([left + 30.0, y + 4.0], family.words(), size).colour(family.colour()));
                y += 21.0;
            }
        }
        y += 10.0;
        for (target, words) in [(Target::CPU_F32, "CPU, f32"), (Target::CPU_F64, "CPU, f64"), (Target::Gpu, "GPU, f32")]
        {
            if self.points.iter().any(|(c, _)| c.target == target) {
                dots(page, &[[left + 10.0, y]], 9.0, target, GREY);
                page.text(Text::new([left + 30.0, y + 4.0], words, size).colour(GREY));
                y += 21.0;
            }
        }
        y += 10.0;
        let mut fudges: Vec<f64> = self.points.iter().map(|(c, _)| c.fudge).collect();
        fudges.sort_by(f64::total_cmp);
        let (least, most) = (fudges[0], fudges[fudges.len() - 1]);
        page.line(&[[left - 2.0, y], [left + 22.0, y]], GREY, 1.4);
        page.dots(&[[left - 2.0, y], [left + 7.0, y], [left + 14.0, y]], 5.5, GREY);
        page.dots(&[[left + 22.0, y]], 9.0, GREY);
        let words = format!("fudge {} to {}", plain(least), plain(most));
        page.text(Text::new([left + 34.0, y + 4.0], words, size).colour(GREY));
        y += 21.0;
        page.line(&[[left, y], [left + 20.0, y]], PALE, 7.0);
        page.text(Text::new([left + 30.0, y + 4.0], "nothing is cheaper and truer", size).colour(GREY));
        y += 21.0;
        page.items.push(Item::Ring { centre: [left + 10.0, y], diameter: 14.0, colour: INK, width: 2.0 });
        page.text(Text::new([left + 30.0, y + 4.0], "what auto takes", size).colour(GREY));
    }

    fn small_panels(&self, page: &mut Drawing) {
        let (top, bottom) = (630.0, 772.0);
        let time = || Words { title: "time per pixel".into(), label: nanoseconds };
        let estimates = || Words { title: "estimates per pixel".into(), label: plain };
        let wrong = || Words { title: "missed + early".into(), label: percent };
        let depth = || Words { title: "median depth error, footprints".into(), label: plain };
        let panels: [(Reading, Reading, Words, Words); 3] = [
            (|m| m.ns_per_pixel, |m| m.median_error, time(), depth()),
            (|m| m.estimates_per_pixel, Measured::wrong, estimates(), wrong()),
            (|m| m.estimates_per_pixel, |m| m.median_error, estimates(), depth()),
        ];
        for (i, (cost, error, x, y)) in panels.into_iter().enumerate() {
            let left = 92.0 + 300.0 * i as f64;
            let points = self.read(cost, error);
            let panel = Panel::fit(&points, [left, top, left + 240.0, bottom]);
            panel.frame(page, &x, &y, 11.5);
            let places: Vec<Point> = points.iter().map(|p| panel.at(*p)).collect();
            let front: Vec<Point> = pareto(&points).into_iter().map(|i| places[i]).collect();
            page.line(&front, PALE, 5.0);
            self.draw_curves(page, &places, 0.62);
            page.items.push(Item::Ring { centre: places[self.auto], diameter: 13.0, colour: INK, width: 1.6 });
        }
    }

    fn notes(&self, page: &mut Drawing) {
        let text = format!(
            "{} rays of the file's own view at {} x {}, {} of them hits (one is {}); {} whose truth did not settle are left out. The truth is a \
             march in f64 by fixed small steps, without any estimate. Missed: passed, or met more than 2 footprints behind. Early: \
             stopped in front by more than 0.5 % of the bounding radius (or four footprints, where those are less), as a share of all stops. A footprint is a pixel's diameter at the hit. Times are \
             those of one machine; estimates per pixel and errors are the same everywhere.",
            self.rays,
            self.size.width,
            self.size.height,
            self.hits,
            percent((1000.0 / self.hits.max(1) as f64).round() / 1000.0),
            self.ambiguous
        );
        caption(page, &text, [MARGIN, 826.0], WIDTH - 2.0 * MARGIN, 11.0);
    }

    /// A line for each candidate, as [`CSV_HEADER`] names them.
    pub fn csv(&self) -> String {
        let front = self.front();
        let mut out = String::new();
        for (i, (c, m)) in self.points.iter().enumerate() {
            let (backend, precision) = target_words(c.target);
            let form = c.form.map_or("own", crate::graph::DeForm::name);
            let _ = writeln!(
                out,
                "{},{},{},{},{},{},{},{form},{},{},{backend},{precision},{},{},{},{},{},{},{},{},{}",
                super::csv_field(&self.formula),
                self.size.width,
                self.size.height,
                self.rays,
                self.hits,
                self.ambiguous,
                method_name(c.method),
                c.fudge,
                c.least_step.map_or(String::new(), |step| step.to_string()),
                m.ns_per_pixel,
                m.estimates_per_pixel,
                m.missed,
                m.early,
                m.median_error,
                m.unfinished,
                m.nan,
                u8::from(front.contains(&i)),
                u8::from(i == self.auto)
            );
        }
        out
    }
}

/// Dots of a target.
fn dots(page: &mut Drawing, at: &[Point], diameter: f64, target: Target, colour: super::Colour) {
    page.dots(at, diameter, colour);
    match target {
        Target::CPU_F32 => {}
        Target::CPU_F64 => page.dots(at, diameter * 0.55, PAPER),
        Target::Gpu => page.dots(at, diameter * 0.5, INK),
    }
}
