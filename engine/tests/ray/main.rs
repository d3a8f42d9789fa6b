//! Ray backends: the trees, and the shader's walk through them.
#[cfg(test)]
mod build;
#[cfg(test)]
mod oracle;
#[cfg(test)]
mod shapes;
#[cfg(test)]
mod traversal;
#[cfg(test)]
mod twin;
