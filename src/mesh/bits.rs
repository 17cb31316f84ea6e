//! Sets of numbers as bits, and how many members come before one.

/// A set of numbers below a limit.
#[derive(Clone, Debug)]
pub(super) struct Bits {
    words: Vec<u64>,
}

impl Bits {
    /// The empty set.
    pub fn new(limit: u64) -> Bits {
        Bits { words: vec![0; limit.div_ceil(64) as usize] }
    }

    /// Whether a number is in it.
    pub fn has(&self, number: u32) -> bool {
        self.words[(number / 64) as usize] >> (number % 64) & 1 == 1
    }

    /// Puts a number in.
    pub fn add(&mut self, number: u32) {
        self.words[(number / 64) as usize] |= 1 << (number % 64);
    }

    /// Takes a number out.
    pub fn remove(&mut self, number: u32) {
        self.words[(number / 64) as usize] &= !(1 << (number % 64));
    }
}

/// The numbers of the bits that are set, from the lowest.
pub(super) fn ones(word: u64) -> impl Iterator<Item = u32> {
    std::iter::successors(Some(word), |word| Some(word & word.wrapping_sub(1)))
        .take_while(|word| *word != 0)
        .map(u64::trailing_zeros)
}

/// A set whose members know their place among them.
#[derive(Clone, Debug)]
pub(super) struct Ranked {
    bits: Bits,
    /// Members before each word.
    before: Vec<u32>,
}

impl Ranked {
    /// Counts the members of a set.
    pub fn new(bits: Bits) -> Ranked {
        let mut count = 0;
        let before = bits.words.iter().map(|word| {
            let before = count;
            count += word.count_ones();
            before
        });
        Ranked { before: before.collect(), bits }
    }

    /// The set, to be changed.
    pub fn into_bits(self) -> Bits {
        self.bits
    }

    /// How many members are less than a member; `None` of what is none.
    pub fn place(&self, number: u32) -> Option<usize> {
        let at = (number / 64) as usize;
        let word = self.bits.words[at];
        let bit = number % 64;
        (word >> bit & 1 == 1).then(|| (self.before[at] + (word & ((1 << bit) - 1)).count_ones()) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::{Bits, Ranked, ones};

    #[test]
    fn members_know_their_place() {
        let numbers = [0, 1, 63, 64, 130, 199];
        let mut bits = Bits::new(200);
        numbers.iter().for_each(|number| bits.add(*number));
        let ranked = Ranked::new(bits);
        assert_eq!(numbers.map(|number| ranked.place(number)), [0, 1, 2, 3, 4, 5].map(Some));
        assert_eq!(ranked.place(2), None);
        let mut bits = ranked.into_bits();
        bits.remove(63);
        assert!(bits.has(64) && !bits.has(63));
        assert_eq!(ones(0b1010_0001).collect::<Vec<_>>(), [0, 5, 7]);
        assert_eq!(ones(1 << 63).collect::<Vec<_>>(), [63]);
    }
}
