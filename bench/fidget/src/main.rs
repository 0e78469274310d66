// One orthographic picture of a formula by fidget, with normals, on one thread: fidget-once MODEL.vm SIZE jit|vm MATRIX DEPTHS
// writes a little-endian u32 for each pixel (0: nothing) and prints the seconds that rendering took.
use fidget_core::{
    context::Context,
    eval::{Function, MathFunction},
    render::{RenderHints, VoxelSize},
    shape::Shape,
    vm::VmFunction,
};
use fidget_jit::JitFunction;
use fidget_raster::voxel::{render, EvalConfig, RenderConfig};
use std::time::Instant;

fn run<F: Function + RenderHints + MathFunction + Clone>(arguments: &[String]) {
    let text = std::fs::read(&arguments[1]).unwrap();
    let (context, root) = Context::from_text(&mut text.as_slice()).unwrap();
    let size: u32 = arguments[2].parse().unwrap();
    let mut wanted = RenderConfig::from_size(VoxelSize::new(size, size, size));
    let numbers: Vec<f32> = arguments[4].split(',').map(|s| s.parse().unwrap()).collect();
    wanted.world_to_model = nalgebra::Matrix4::from_row_slice(&numbers);
    let how = EvalConfig { threads: None, ..Default::default() };
    let begin = Instant::now();
    let shape = Shape::<F>::new(&context, root).unwrap();
    let image = render(shape.try_into().ok().unwrap(), &wanted, &how).unwrap();
    println!("{:.9}", begin.elapsed().as_secs_f64());
    let depths: Vec<u8> = image.as_slice().iter().flat_map(|p| p.depth.to_le_bytes()).collect();
    std::fs::write(&arguments[5], depths).unwrap();
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    if arguments[3] == "jit" {
        run::<JitFunction>(&arguments)
    } else {
        run::<VmFunction>(&arguments)
    }
}
