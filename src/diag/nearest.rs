//! The legal name that a mistyped one probably stands for.

/// Names longer than this are not compared, so that the cost stays bounded.
const MAX_LETTERS: usize = 64;

/// Finds the candidate that differs least from `name`, ignoring case.
///
/// Range: at most a third of the letters (of the longer word) may be missing, extra, changed or
/// swapped with their neighbour; else `None`. The first of several equally near ones wins.
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let letters = name.chars().count();
    if letters > MAX_LETTERS {
        return None;
    }
    let wanted = name.to_lowercase();
    let mut best: Option<(usize, &str)> = None;
    for candidate in candidates {
        let longer = candidate.chars().count().max(letters);
        if longer > MAX_LETTERS {
            continue;
        }
        let off = strsim::osa_distance(&wanted, &candidate.to_lowercase());
        if off * 3 <= longer && best.is_none_or(|(least, _)| off < least) {
            best = Some((off, candidate));
        }
    }
    best.map(|(_, candidate)| candidate)
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn finds_swapped_missing_and_wrongly_cased_letters() {
        let names = ["limit", "scale", "min_radius", "fixed_radius"];
        assert_eq!(nearest("limti", names), Some("limit"));
        assert_eq!(nearest("SCALE", names), Some("scale"));
        assert_eq!(nearest("minradius", names), Some("min_radius"));
        assert_eq!(nearest("fixed_radiu", names), Some("fixed_radius"));
    }

    #[test]
    fn stays_silent_when_nothing_is_near() {
        assert_eq!(nearest("colour", ["limit", "scale"]), None);
        assert_eq!(nearest("x", ["y"]), None);
        assert_eq!(nearest("", ["limit", ""]), Some(""));
        assert_eq!(nearest("a", []), None);
        assert_eq!(nearest(&"a".repeat(1_000_000), ["a"]), None);
        assert_eq!(nearest("a", ["a".repeat(1_000_000).as_str()]), None);
    }

    #[test]
    fn the_nearer_and_then_the_first_wins() {
        assert_eq!(nearest("bulb_powr", ["bulb_pwr2", "bulb_power"]), Some("bulb_power"));
        assert_eq!(nearest("fold", ["gold", "bold"]), Some("gold"));
    }
}
