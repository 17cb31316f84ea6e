//! Adapters: which there are, and which one is taken.

use crate::kernel::BackendError;
use crate::kernel::cpu::is_refused;

/// Which adapters are good enough.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum AdapterWanted {
    /// Real graphics hardware only.
    Hardware,
    /// Also software drivers such as lavapipe, where there is no hardware.
    Any,
}

/// One adapter, as the `doctor` command lists it.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct AdapterInfoLine {
    /// The adapter's name.
    pub name: String,
    /// Graphics interface: `Vulkan`, `Metal` or `Dx12`.
    pub backend: String,
    /// `DiscreteGpu`, `IntegratedGpu`, `VirtualGpu`, `Cpu` or `Other`.
    pub device_type: String,
    /// Driver and its version.
    pub driver: String,
    /// True for a software driver, which counts as no GPU.
    pub is_software: bool,
}

impl AdapterInfoLine {
    fn new(info: &wgpu::AdapterInfo) -> AdapterInfoLine {
        AdapterInfoLine {
            name: info.name.clone(),
            backend: format!("{:?}", info.backend),
            device_type: format!("{:?}", info.device_type),
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_string(),
            is_software: info.device_type == wgpu::DeviceType::Cpu,
        }
    }
}

/// Every adapter that could be used, best first. Empty where there is no driver or no loader.
pub fn adapters() -> Vec<AdapterInfoLine> {
    sorted(&instance()).iter().map(|adapter| AdapterInfoLine::new(&adapter.get_info())).collect()
}

/// An instance without validation layers and debug output.
///
/// Mesa's implicit layer `device_select` may still complain of a missing `XDG_RUNTIME_DIR` on stderr; a program that sets
/// `NODEVICE_SELECT=1` in its environment before it starts threads is spared that.
fn instance() -> wgpu::Instance {
    wgpu::Instance::new(wgpu::InstanceDescriptor {
        flags: wgpu::InstanceFlags::empty(),
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    })
}

fn sorted(instance: &wgpu::Instance) -> Vec<wgpu::Adapter> {
    let mut adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
    adapters.sort_by_key(|adapter| match adapter.get_info().device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    });
    adapters
}

/// The best adapter of the kind wanted. Software drivers make machine code, and end the process where the system refuses that.
pub(super) fn choose(wanted: AdapterWanted) -> Result<(wgpu::Adapter, AdapterInfoLine), BackendError> {
    let all = sorted(&instance());
    let (mut software, takes_software) = (Vec::new(), wanted == AdapterWanted::Any && !is_refused());
    for adapter in all {
        let line = AdapterInfoLine::new(&adapter.get_info());
        if takes_software || !line.is_software {
            return Ok((adapter, line));
        }
        software.push(line.name);
    }
    Err(BackendError::NoAdapter(if software.is_empty() {
        "no Vulkan, Metal or Direct3D 12 driver was found".to_string()
    } else {
        let why = if is_refused() { ", and the system refuses the machine code that they make" } else { "" };
        format!("only software drivers were found ({}){why}", software.join(", "))
    }))
}
