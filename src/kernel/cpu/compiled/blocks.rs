//! Kernels that run over columns block by block: what they read and write, and the loop around them.
//!
//! A block is as many elements as there are lanes in step. The frame holds the address of each column's part in the current
//! block; at its end the addresses move on.

use iced_x86::{Code, Instruction, MemoryOperand, Register};

use super::assemble::{Assembler, FRAME, Label, VALID, WANTED};
use super::instructions::Form;

/// Bytes of an address.
pub(super) const ADDRESS: usize = size_of::<u64>();

impl Assembler {
    /// Where the address of a column lies.
    fn address(&self, column: u16) -> MemoryOperand {
        let first = usize::from(self.first_address) * self.set.bytes();
        MemoryOperand::with_base_displ(FRAME, (first + usize::from(column) * ADDRESS) as i64)
    }

    /// A copy's vector of a column.
    fn column(&mut self, column: u16, copy: u8) -> MemoryOperand {
        let address = self.address(column);
        self.push(Instruction::with2(Code::Mov_r64_rm64, Register::RAX, address).expect(VALID));
        MemoryOperand::with_base_displ(Register::RAX, (usize::from(copy) * self.set.bytes()) as i64)
    }

    /// Loads from a column.
    pub(super) fn load_column(&mut self, dst: u8, column: u16, copy: u8) {
        let from = self.column(column, copy);
        let code = self.code(Form::LoadUnaligned);
        self.push(Instruction::with2(code, self.vector(dst), from).expect(VALID));
    }

    /// Stores to a column.
    pub(super) fn store_column(&mut self, column: u16, copy: u8, source: u8) {
        let to = self.column(column, copy);
        let code = self.code(Form::StoreUnaligned);
        self.push(Instruction::with2(code, to, self.vector(source)).expect(VALID));
    }

    /// Moves the addresses of columns on by a block, and jumps while blocks are left.
    pub(super) fn next_block(&mut self, columns: impl Iterator<Item = u16>, copies: usize, again: Label) {
        let block = copies * self.set.bytes();
        for column in columns {
            let address = self.address(column);
            self.push(Instruction::with2(Code::Add_rm64_imm32, address, block as i32).expect(VALID));
        }
        self.push(Instruction::with1(Code::Dec_rm64, WANTED).expect(VALID));
        self.branch(Code::Jne_rel32_64, again);
    }
}
